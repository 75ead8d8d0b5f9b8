"""`limberjack view`: a task, live, in a browser or a window."""

import contextlib
import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, cast

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    Appearance,
    EnvironmentName,
    Faults,
    OptionalDomain,
    Seed,
    TaskName,
    TimeLimit,
    named_environment,
    world_named,
)
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    complain,
    misuse_reported,
    remarks_reported,
    search_working_directory,
    users_failure,
)

if TYPE_CHECKING:
    import dm_env

    from limberjack.rl.control import Environment
    from limberjack.viewer import Plans
    from limberjack.viewer.panel import Worded
    from limberjack.viewer.session import Begin, Session, Status
    from limberjack.workers.factories import Factory

    Show = Callable[[Session], None]

__all__: list[str] = []

_THIS_MACHINE = "127.0.0.1"
_OF_APPEARANCE = (
    "of the appearance, the viewer shows colours, background and the model's cameras as at the "
    "start of each episode; select a camera with [ and ], since the viewer's own has no look"
)
_OTHER_SEEDS = (
    "the function makes another environment for each seed: the first episode is that of the seed, "
    "and the next ones continue its random stream; start again for another seed"
)


@command(
    "view",
    "limberjack view humanoid walk --policy random",
    "limberjack view humanoid/walk --policy sb3:walk.zip --speed 0.5",
    "limberjack view stacker stack_2 --policy planner --explain",
)
def _view(
    context: typer.Context,
    domain: OptionalDomain = None,
    task: TaskName = None,
    env: EnvironmentName = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="What acts, as for run, or none; repeat it to choose from several on the page.",
        ),
    ] = None,
    seed: Seed = 0,
    time_limit: TimeLimit = None,
    faults: Faults = None,
    appearance: Appearance = None,
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Show stage, terms and weights of the planner's plans."),
    ] = False,
    speed: Annotated[float, typer.Option(metavar="X", help="Simulated seconds per second.")] = 1.0,
    quality: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="full, or fast: no shadows and reflections; auto is fast without a GPU.",
        ),
    ] = "auto",
    native: Annotated[
        bool, typer.Option("--native", help="Open a window instead of serving a browser.")
    ] = False,
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets other machines in.")
    ] = _THIS_MACHINE,
    port: Annotated[
        int | None,
        typer.Option(
            metavar="N", help="Port to listen on; the first free one from 8080 by default."
        ),
    ] = None,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Another name that browsers may use, as of a proxy; repeatable."
        ),
    ] = None,
) -> None:
    """Show a task, live: pause it, step it, reset it, push its bodies with the mouse.

    Open the printed address in a browser; without the token in it nobody gets in. Space pauses,
    backspace begins the next episode, the right arrow takes a step while paused. A double click
    selects a body; dragging with Ctrl and the right button pushes it, with Ctrl and the left button
    twists it. Ctrl-C here ends the viewer. With the policy none, the default, the actions are the
    middle of their bounds.
    """
    with misuse_reported():
        from limberjack.policies.built_in import PLANNER
        from limberjack.viewer import Plans, offered
        from limberjack.viewer.session import NO_POLICY
        from limberjack.workers.factories import factory_of

        where = named_environment(domain, task, env, time_limit)
        factory = factory_of(*where, time_limit, world_named(env, faults, appearance))
        plans = Plans()
        named = {"--env": env, "--faults": faults, "--appearance": appearance}
        modules = context.find_root().params["modules"] or []
        worded = _command_line(modules, (domain, task), named, time_limit, explain)
        show = _find_viewer(native, host, port, allow_host or [], factory.title, plans, worded)
        environment = _viewable(factory.make(seed))
        if appearance is not None:
            complain(_OF_APPEARANCE)
        with remarks_reported():
            names = [*(policy or [NO_POLICY]), *([PLANNER] if explain else [])]
            for name in names:
                search_working_directory(name)
            begins = offered(environment, names, plans if explain else None)
        first = seed if env is None or _begins_seeds(factory, environment, seed) else None
        if first is None:
            complain(_OTHER_SEEDS)
    with contextlib.closing(environment):
        raise typer.Exit(_show(environment, begins, first, speed, quality, show, plans))


def _begins_seeds(factory: "Factory", environment: "dm_env.Environment", seed: int) -> bool:
    """Whether an environment begins the episodes of other seeds as one that is made for them."""
    from limberjack.rl.builds import is_stable

    return is_stable(factory.build(environment), seed)


def _find_viewer(
    native: bool,
    host: str,
    port: int | None,
    allow_hosts: list[str],
    title: str,
    plans: "Plans",
    worded: "Worded",
) -> "Show":
    """The function that shows a session in the chosen viewer."""
    from limberjack import viewer
    from limberjack.viewer.access import Access, find_address

    if native:
        if host != _THIS_MACHINE or port is not None or allow_hosts:
            raise ValueError(
                "--native opens a window and listens on no port: leave out --host, --port and "
                "--allow-host, or --native"
            )
        return viewer.in_window()
    address = find_address(host, port)
    access = Access(address, allow_hosts)
    try:
        show = viewer.in_browsers(
            access, title, lambda url: typer.echo(f"{url}  (Ctrl-C ends it)"), plans.weigh, worded
        )
    except ImportError as error:
        complain(f"limberjack view {error}; --native needs nothing")
        raise typer.Exit(FAILED) from None
    if not address.is_local:
        complain(
            f"port {address.port} is open to other machines and is not encrypted: anyone on the "
            "network can read the token; a tunnel is safe, and browsers on other machines show the "
            f"page only through one, or HTTPS: ssh -L {address.port}:localhost:{address.port}"
        )
    return show


def _viewable(environment: "dm_env.Environment") -> "Environment":
    """The environment; raises ValueError unless it has what a viewer needs."""
    for name in ("physics", "task", "reseed"):
        if not hasattr(environment, name):
            raise ValueError(
                f"a {type(environment).__name__} has no {name}, which a viewer needs: expected a "
                "limberjack.rl.control.Environment, or a subclass"
            )
    return cast("Environment", environment)


def _command_line(
    modules: Sequence[str],
    task: tuple[str | None, ...],
    options: Mapping[str, str | None],
    time_limit: float | None,
    explain: bool,
) -> "Worded":
    """A function that words a status as the command that shows its episode."""
    given = dict(options)
    if time_limit is not None:
        given["--time-limit"] = repr(time_limit).removesuffix(".0")
    start = ["limberjack", *(word for module in modules for word in ("--import", module)), "view"]
    start += [part for part in task if part]
    others = [part for name, value in given.items() if value is not None for part in (name, value)]

    def worded(status: "Status") -> str:
        words = [*start, "--policy", status.policy, *others]
        if status.seed is not None:
            words += ["--seed", str(status.seed)]
        if status.speed != 1:
            words += ["--speed", f"{status.speed:.3g}"]
        if status.quality != "auto":
            words += ["--quality", status.quality]
        return shlex.join(words + ["--explain"] * explain)

    return worded


def _show(
    environment: "Environment",
    begins: "Mapping[str, Begin]",
    seed: int | None,
    speed: float,
    quality: str,
    show: "Show",
    plans: "Plans",
) -> int:
    """Shows the environment until the viewer is closed; returns the exit status."""
    from limberjack.policies import PolicyError
    from limberjack.rl.control import PhysicsError
    from limberjack.viewer.session import Session, ViewerError

    try:
        with misuse_reported():
            session = Session(
                environment, begins, seed=seed, speed=speed, plan=plans.last, quality=quality
            )
        show(session)
    except KeyboardInterrupt:
        return INTERRUPTED
    except (PolicyError, PhysicsError, ViewerError, OSError) as error:
        complain(error)
        return FAILED
    except Exception as error:
        sentence = users_failure(error)
        if sentence is None:
            raise
        complain(sentence)
        return FAILED
    return 0
