"""`limberjack view`: a task, live, in a browser or a window."""

import contextlib
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import Domain, FirstSeed, TaskName, TimeLimit, named_task
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    complain,
    find_policy,
    misuse_reported,
    users_failure,
)

if TYPE_CHECKING:
    from limberjack.rl.control import Environment
    from limberjack.viewer.session import Begin, Session

    Show = Callable[[Session], None]

__all__: list[str] = []

_NO_POLICY = "none"


@command(
    "view",
    "limberjack view humanoid walk --policy random",
    "limberjack view humanoid/walk --policy sb3:walk.zip --speed 0.5",
)
def _view(
    domain: Domain,
    task: TaskName = None,
    policy: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="What acts: none, zero, random, planner, MODULE:CALLABLE, or sb3:PATH of a saved "
            "model.",
        ),
    ] = _NO_POLICY,
    seed: FirstSeed = 0,
    time_limit: TimeLimit = None,
    speed: Annotated[float, typer.Option(help="Simulated seconds per second.")] = 1.0,
    native: Annotated[
        bool, typer.Option("--native", help="Open a window instead of serving a browser.")
    ] = False,
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets other machines in.")
    ] = "127.0.0.1",
    port: Annotated[
        int | None, typer.Option(help="Port to listen on; the first free one from 8080 by default.")
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
    twists it. Ctrl-C here ends the viewer.
    """
    with misuse_reported():
        domain, task = named_task(domain, task)
        show = _find_viewer(native, host, port, allow_host or [], f"{domain} {task}")
        environment = _load(domain, task, seed, time_limit)
        begin = _begin(policy, environment)
    with contextlib.closing(environment):
        raise typer.Exit(_show(environment, begin, seed, speed, show))


def _find_viewer(
    native: bool, host: str, port: int | None, allow_hosts: list[str], title: str
) -> "Show":
    """The function that shows a session in the chosen viewer."""
    from limberjack import viewer
    from limberjack.viewer.access import Access
    from limberjack.viewer.address import find_address

    if native:
        return viewer.in_window()
    address = find_address(host, port)
    access = Access(address, allow_hosts)
    try:
        show = viewer.in_browsers(access, title, _print_address)
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


def _load(domain: str, task: str, seed: int, time_limit: float | None) -> "Environment":
    from limberjack import suite
    from limberjack.rl.batches import vectorisable

    if time_limit is not None and math.isinf(time_limit):
        raise ValueError(f"--time-limit is {time_limit}; expected a number of seconds")
    task_kwargs: dict[str, float] = {"random": seed}
    if time_limit is not None:
        task_kwargs["time_limit"] = time_limit
    return vectorisable(suite.load(domain, task, task_kwargs=task_kwargs))


def _begin(policy: str, environment: "Environment") -> "Begin":
    """The function that begins the policy's episodes."""
    from limberjack import viewer

    if policy == _NO_POLICY:
        return viewer.begin_with(None)
    return viewer.begin_policy(find_policy(policy, environment))


def _show(environment: "Environment", begin: "Begin", seed: int, speed: float, show: "Show") -> int:
    """Shows the environment until the viewer is closed; returns the exit status."""
    from limberjack.policies import PolicyError
    from limberjack.rl.control import PhysicsError
    from limberjack.viewer.session import Session, ViewerError

    try:
        with misuse_reported():
            session = Session(environment, begin, seed, speed)
        show(session)
    except KeyboardInterrupt:
        return INTERRUPTED
    except (PolicyError, PhysicsError, ViewerError) as error:
        complain(error)
        return FAILED
    except Exception as error:
        sentence = users_failure(error)
        if sentence is None:
            raise
        complain(sentence)
        return FAILED
    return 0


def _print_address(url: str) -> None:
    typer.echo(f"{url}  (Ctrl-C ends it)")
