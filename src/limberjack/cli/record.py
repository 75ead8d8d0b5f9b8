"""`limberjack record`: a film of an episode, of several side by side, or of a recorded one."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    ActionRepeat,
    Appearance,
    Camera,
    EnvironmentName,
    Faults,
    OptionalDomain,
    PolicyName,
    Seed,
    TaskName,
    camera_named,
    function_named,
    named_environment,
    world_named,
)
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    MISUSED,
    complain,
    remarks_reported,
    search_working_directory,
    users_failure,
    worded,
)
from limberjack.cli.progress import show_film

__all__: list[str] = []

_Pixels = Annotated[int, typer.Option(metavar="N", min=2, help="Of the film, pixels.")]
_Overlay = Annotated[
    bool, typer.Option("--overlay", help="Draw time, reward and return in a corner.")
]
_Colours = Annotated[
    bool, typer.Option("--visualize-reward", help="Colour the bodies by the reward.")
]
_Out = Annotated[Path, typer.Option(metavar="FILE", help="The film; ends in .mp4 or .gif.")]
_From = Annotated[
    str | None,  # a Path would take a slash from a URL
    typer.Option(
        "--from",
        metavar="DIR",
        help="Film the episode of --seed of a dataset that `limberjack collect` wrote, in a "
        "folder or at a URL.",
    ),
]
_Seconds = Annotated[
    float | None,
    typer.Option(metavar="X", help="Of simulated time; the task's time limit by default."),
]
_Rows = Annotated[
    int, typer.Option(metavar="N", min=1, help="Episodes side by side; row i has seed + i.")
]


@command(
    "record",
    "limberjack record humanoid walk --policy random --out walk.mp4",
    "limberjack record stacker/stack_2 --rows 4 --seconds 5 --out stack.gif",
    "limberjack record --from walk --seed 3 --out walk-3.mp4",
)
def _record(
    domain: OptionalDomain = None,
    task: TaskName = None,
    *,
    out: _Out,
    env: EnvironmentName = None,
    dataset: _From = None,
    policy: PolicyName = "zero",
    seed: Seed = 0,
    action_repeat: ActionRepeat = None,
    faults: Faults = None,
    appearance: Appearance = None,
    camera: Camera = None,
    height: _Pixels = 480,
    width: _Pixels = 640,
    seconds: _Seconds = None,
    rows: _Rows = 1,
    overlay: _Overlay = False,
    visualize_reward: _Colours = False,
) -> None:
    """Film an episode of a task as MP4 or GIF, in real time.

    With --rows it films a batch; --height and --width are then those of all pictures together. The
    file is written completely or not at all.
    """
    from limberjack.episodes.films import View

    view = View(height=height, width=width, overlay=overlay, visualize_reward=visualize_reward)
    if camera is not None:
        view["camera"] = camera_named(camera)
    search_working_directory(policy)
    with remarks_reported(), _failures_reported(out) as show:
        if dataset is not None:
            given = (domain, task, seconds, action_repeat, faults, appearance)
            if any(one is not None for one in given) or policy != "zero" or rows > 1:
                raise ValueError(
                    f"--from {dataset} has the task, the policy and the length of the episode: "
                    "leave out DOMAIN TASK, --policy, --action-repeat, --faults, --appearance, "
                    "--seconds and --rows"
                )
            from limberjack import data

            make = None if env is None else function_named(env)
            path = data.film(data.load(dataset), seed, make, out=out, on_progress=show, **view)
        else:
            if domain is None and env is None:
                raise ValueError(
                    "got no task; expected DOMAIN TASK, --env MODULE:FUNCTION, or --from DIR of a "
                    "dataset. `limberjack list` shows all tasks"
                )
            from limberjack.episodes.films import record

            path = record(
                *named_environment(domain, task, env),
                out=out,
                policy=policy,
                seed=seed,
                seconds=seconds,
                rows=rows,
                action_repeat=action_repeat,
                world=world_named(env, faults, appearance),
                on_progress=show,
                **view,
            )
    typer.echo(path)


@contextlib.contextmanager
def _failures_reported(path: Path) -> Iterator[Callable[[int, int, float], None]]:
    """Turns an error or interrupt into one line and an exit status; yields a progress function.

    Before the episode has begun, an error is a mistake on the command line; later it is one of the
    policy or the task.
    """
    from limberjack.episodes.films import DepartedError
    from limberjack.mujoco.camera import RenderingError
    from limberjack.policies import PolicyError
    from limberjack.rl.control import PhysicsError

    begun = False

    def show(steps: int, limit: int, total: float) -> None:
        nonlocal begun
        begun = True
        show_step(steps, limit, total)

    try:
        with show_film() as show_step:
            yield show
    except KeyboardInterrupt:
        complain(f"interrupted: {path} is not written")
        raise typer.Exit(INTERRUPTED) from None
    except Exception as error:
        failures = (DepartedError, ImportError, OSError, PhysicsError, RenderingError)
        failed = begun or isinstance(error, failures)
        is_known = isinstance(error, (*failures, PolicyError)) or (
            isinstance(error, ValueError) and not begun
        )
        sentence = worded(error) if is_known else users_failure(error)
        if sentence is None:
            raise
        complain(f"no {path}: {sentence}" if failed else sentence)
        raise typer.Exit(FAILED if failed else MISUSED) from None
