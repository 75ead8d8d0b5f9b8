"""`limberjack record`: a film of an episode, or of several side by side."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import Domain, PolicyName, TaskName, named_task
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    MISUSED,
    SEEDS,
    complain,
    search_working_directory,
)
from limberjack.cli.progress import show_episodes

__all__: list[str] = []

_Seed = Annotated[int, typer.Option(min=0, max=SEEDS - 1, help="Of the episode; row i has seed+i.")]
_Pixels = Annotated[int, typer.Option(min=2, help="Of the film, pixels.")]
_Overlay = Annotated[
    bool, typer.Option("--overlay", help="Draw time, reward and return in a corner.")
]
_Colours = Annotated[
    bool, typer.Option("--visualize-reward", help="Colour the bodies by the reward.")
]


@command(
    "record",
    "limberjack record humanoid walk --policy random --out walk.mp4",
    "limberjack record stacker/stack_2 --rows 4 --seconds 5 --out stack.gif",
)
def _record(
    domain: Domain,
    task: TaskName = None,
    *,
    out: Annotated[Path, typer.Option(metavar="FILE", help="The film; ends in .mp4 or .gif.")],
    policy: PolicyName = "zero",
    seed: _Seed = 0,
    camera: Annotated[str, typer.Option(help="Its name or number; -1 is the free camera.")] = "0",
    height: _Pixels = 480,
    width: _Pixels = 640,
    seconds: Annotated[
        float | None, typer.Option(help="Of simulated time; the task's time limit by default.")
    ] = None,
    rows: Annotated[int, typer.Option(min=1, help="Episodes of a batch, side by side.")] = 1,
    overlay: _Overlay = False,
    visualize_reward: _Colours = False,
) -> None:
    """Film an episode of a task as MP4 or GIF, in real time.

    With --rows it films a batch; --height and --width are then those of all pictures together. The
    file is written completely or not at all.
    """
    search_working_directory(policy)
    with _failures_reported(out) as show:
        from limberjack.recording import record

        path = record(
            *named_task(domain, task),
            out=out,
            policy=policy,
            seed=seed,
            camera=int(camera) if camera.removeprefix("-").isdecimal() else camera,
            height=height,
            width=width,
            seconds=seconds,
            rows=rows,
            overlay=overlay,
            visualize_reward=visualize_reward,
            on_progress=show,
        )
    typer.echo(path)


@contextlib.contextmanager
def _failures_reported(path: Path) -> Iterator[Callable[[int, int, float], None]]:
    """Turns an error or interrupt into one line and an exit status; yields a progress function.

    Before the episode has begun, a ValueError is a mistake on the command line; later it is an
    error of the policy's own, whose traceback says more.
    """
    from limberjack.mujoco.camera import RenderingError
    from limberjack.policies import PolicyError
    from limberjack.rl.control import PhysicsError

    begun = False

    def show(steps: int, limit: int, total: float) -> None:
        nonlocal begun
        begun = True
        progress.show(0, steps, limit, total)

    try:
        with show_episodes(1) as progress:
            yield show
    except KeyboardInterrupt:
        complain(f"interrupted: {path} is not written")
        raise typer.Exit(INTERRUPTED) from None
    except (ImportError, OSError, PhysicsError, RenderingError) as error:
        complain(f"no {path}: {error}")
        raise typer.Exit(FAILED) from None
    except ValueError as error:
        if not begun:
            complain(error)
            raise typer.Exit(MISUSED) from None
        if not isinstance(error, PolicyError):
            raise
        complain(f"no {path}: {error}")
        raise typer.Exit(FAILED) from None
