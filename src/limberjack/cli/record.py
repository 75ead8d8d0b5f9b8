"""`limberjack record`: a film of an episode, of several side by side, or of a recorded one."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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
    refuse_beside,
    world_named,
)
from limberjack.cli.output import failures_reported, remarks_reported, search_working_directory
from limberjack.cli.progress import show_steps

if TYPE_CHECKING:
    from limberjack.data import Dataset
    from limberjack.workers.factories import Make

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
    from limberjack.episodes import films

    view = films.View(
        height=height, width=width, overlay=overlay, visualize_reward=visualize_reward
    )
    if camera is not None:
        view["camera"] = camera_named(camera)
    search_working_directory(policy)
    with (
        remarks_reported(),
        show_steps("filming") as progress,
        failures_reported(progress, lambda: f"{out} is not written", _failures()),
    ):
        if dataset is not None:
            others = {
                "DOMAIN": domain,
                "--policy": None if policy == "zero" else policy,
                "--seconds": seconds,
                "--rows": None if rows == 1 else rows,
                "--action-repeat": action_repeat,
                "--faults": faults,
                "--appearance": appearance,
            }
            recorded, make = _recorded(dataset, env, others)
            path = films.film(recorded, seed, make, out=out, on_progress=progress.show, **view)
        else:
            path = films.record(
                *named_environment(domain, task, env),
                out=out,
                policy=policy,
                seed=seed,
                seconds=seconds,
                rows=rows,
                action_repeat=action_repeat,
                world=world_named(env, faults, appearance),
                on_progress=progress.show,
                **view,
            )
    typer.echo(path)


def _recorded(
    dataset: str, env: str | None, others: Mapping[str, object]
) -> "tuple[Dataset, Make | None]":
    """A dataset, and the function of --env; raises ValueError if there are other options."""
    refuse_beside(others, f"--from {dataset}, which has the episode: leave it out")
    from limberjack import data

    return data.load(dataset), None if env is None else function_named(env)


def _failures() -> tuple[type[Exception], ...]:
    """Errors that are no mistakes on the command line, before the episode has begun either."""
    from limberjack.episodes.films import DepartedError
    from limberjack.mujoco.camera import RenderingError
    from limberjack.rl.control import PhysicsError

    return DepartedError, ImportError, OSError, PhysicsError, RenderingError
