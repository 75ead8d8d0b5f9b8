"""`limberjack record`: a film of an episode, or of many side by side."""

import contextlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from limberjack.cli.app import app
from limberjack.cli.options import Domain, PolicyName, TaskName
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    SEEDS,
    Progress,
    complain,
    find_policy,
    misuse_reported,
    show_progress,
)

if TYPE_CHECKING:
    import numpy as np

__all__: list[str] = []

_LARGEST = 2160, 3840  # height and width of a picture, pixels; beyond it memory may run out
_TABLE_WIDTH = 320  # pixels; on narrower pictures a table of three lines would hide too much


@app.command("record")
def _record(
    domain: Domain,
    task: TaskName,
    out: Annotated[Path, typer.Option(metavar="FILE", help="Ends in .mp4 or .gif.")],
    policy: PolicyName = "zero",
    seed: Annotated[
        int, typer.Option(min=0, max=SEEDS - 1, help="Of the episode; of row i it is seed+i.")
    ] = 0,
    camera: Annotated[str, typer.Option(help="Its name or number; -1 is the free camera.")] = "0",
    height: Annotated[int, typer.Option(min=2, help="Of the film, pixels.")] = 480,
    width: Annotated[int, typer.Option(min=2, help="Of the film, pixels.")] = 640,
    seconds: Annotated[
        float | None, typer.Option(help="How long; the task's time limit by default.")
    ] = None,
    rows: Annotated[int, typer.Option(min=1, help="Episodes of a batch, side by side.")] = 1,
    overlay: Annotated[
        bool, typer.Option("--overlay", help="Draw time, reward and return in a corner.")
    ] = False,
    visualize_reward: Annotated[
        bool, typer.Option("--visualize-reward", help="Colour the bodies by the reward.")
    ] = False,
) -> None:
    """Film an episode of a task as MP4 or GIF, in real time.

    With --rows it films a batch; --height and --width are then those of all pictures together. It
    is written whole or not at all.
    """
    with _failures_reported(out):
        with misuse_reported():
            if seed + rows > SEEDS:
                last = seed + rows - 1
                raise ValueError(f"the last row's seed is {last}; expected below {SEEDS}")
            stage = _Stage(domain, task, seed, seconds, visualize_reward)
            acts = _find_policies(policy, rows)
            stage.look(camera, height, width, rows, overlay)
            stage.begin_film(out)
        with contextlib.closing(stage), show_progress(1) as progress:
            if rows == 1:
                stage.play(acts[0], progress)
            else:
                stage.play_batch(acts, progress)
            stage.finish_film()
    typer.echo(out)


class _Stage:
    """An environment that is drawn, by itself or in the place of each row of a batch."""

    def __init__(
        self, domain: str, task: str, seed: int, seconds: float | None, visualize_reward: bool
    ) -> None:
        """Checks what was asked for; raises ValueError."""
        from limberjack import suite

        if seconds is not None and math.isinf(seconds):
            raise ValueError(f"--seconds is {seconds}; expected a number of seconds")
        self._where = domain, task
        self._seed = seed
        self._task_kwargs = {} if seconds is None else {"time_limit": seconds}
        self._environment: Any = suite.load(
            domain,
            task,
            {"random": seed, **self._task_kwargs},
            visualize_reward=visualize_reward,
        )
        self._film: Any = None

    def look(self, camera: str, height: int, width: int, rows: int, overlay: bool) -> None:
        """Chooses how it is drawn, and draws it once.

        Raises:
          ValueError: there is no such camera, or the size is too large, or too small for the rows.
          RenderingError: no OpenGL can be had.
        """
        across = math.ceil(math.sqrt(rows))
        down = math.ceil(rows / across)
        # Even, so that the film is.
        picture = height // down // 2 * 2, width // across // 2 * 2
        if 0 in picture:
            raise ValueError(f"a film of {height}x{width} pixels is too small for {rows} rows")
        if rows > 1:
            height, width = picture[0] * down, picture[1] * across
        self._size = height, width
        number = camera.removeprefix("-").isdecimal()
        self._view: dict[str, Any] = {"camera_id": int(camera) if number else camera}
        self._view |= {"height": height // down, "width": width // across}
        self._overlay = overlay
        # The suite's models have a buffer of 480 by 640; no other environment has this model.
        buffer, (most_height, most_width) = self._environment.physics.model.vis.global_, _LARGEST
        buffer.offheight = max(buffer.offheight, min(self._view["height"], most_height))
        buffer.offwidth = max(buffer.offwidth, min(self._view["width"], most_width))
        self._environment.physics.render(**self._view)

    def begin_film(self, path: Path) -> None:
        """Raises ImportError, OSError or ValueError."""
        from limberjack.video import Film

        if not path.parent.is_dir():
            raise ValueError(f"--out is {path}; there is no directory {path.parent}")
        if path.is_dir():
            raise ValueError(f"--out is {path}, a directory; expected a file's name")
        height, width = self._size
        timestep = self._environment.control_timestep()
        self._film = Film(path, timestep, height=height, width=width)

    def finish_film(self) -> None:
        self._film.finish()

    def close(self) -> None:
        """Frees the environment and removes a film that is not finished."""
        self._film.discard()
        self._environment.close()

    def play(self, policy: Any, progress: Progress) -> None:
        """Films an episode."""
        from limberjack import rollout

        before = 0.0

        def on_step(steps: int, total: float) -> None:
            nonlocal before
            reward, before = total - before, total
            progress.show(0, steps, self._environment.step_limit, total)
            self._film.add_picture(lambda: self._picture(steps, reward, total))

        rollout.run_episode(self._environment, policy, self._seed, on_step)

    def play_batch(self, policies: list[Any], progress: Progress) -> None:
        """Films an episode of each row of a batch, side by side."""
        import numpy as np

        from limberjack import suite
        from limberjack.video import mosaic

        count, limit = len(policies), self._environment.step_limit
        batch = suite.load_batch(
            *self._where, num_envs=count, seed=self._seed, task_kwargs=self._task_kwargs
        )
        spec = self._environment.action_spec()
        acts = [begin(spec, self._seed + row) for row, begin in enumerate(policies)]
        time_step, total = batch.reset(), np.zeros(count)

        def pictures(steps: int) -> "np.ndarray":
            return mosaic([self._row(batch, row, steps, time_step, total) for row in range(count)])

        with contextlib.closing(batch):
            self._film.add_picture(lambda: pictures(0))
            for step in range(1, limit + 1):
                seen = time_step.observation
                actions = [act(_row_of(seen, row)) for row, act in enumerate(acts)]
                time_step = batch.step(np.stack(actions))
                total += time_step.reward
                progress.show(0, step, limit, float(total.mean()))
                self._film.add_picture(lambda steps=step: pictures(steps))

    def _row(
        self, batch: Any, row: int, steps: int, time_step: Any, total: "np.ndarray"
    ) -> "np.ndarray":
        """The picture of a row, drawn where its model has no other row's colours."""
        environment = self._environment
        environment.restore(batch.snapshot([row]))
        environment.task.after_step(environment.physics)  # colours it, if that was asked for
        return self._picture(steps, float(time_step.reward[row]), float(total[row]))

    def _picture(self, steps: int, reward: float, total: float) -> "np.ndarray":
        from limberjack.mujoco import TextOverlay

        overlays = []
        if self._overlay:
            time = f"{steps * self._environment.control_timestep():.2f} s"
            names, values = "time\nreward\nreturn", f"{time}\n{reward:.3f}\n{total:.1f}"
            if self._view["width"] < _TABLE_WIDTH:
                names, values = time, f"{reward:.3f}"
            overlays = [TextOverlay(names, values, position="bottom left")]
        return self._environment.physics.render(overlays=overlays, **self._view)


def _find_policies(name: str, rows: int) -> list[Any]:
    """The policy of each row: an object of its own, where it is an object."""
    from limberjack.policies import EnvironmentPolicy

    found = [find_policy(name) for _ in range(rows)]
    if rows > 1 and isinstance(found[0], EnvironmentPolicy):
        raise ValueError(f"policy {name!r} acts in one environment; leave out --rows")
    return found


def _row_of(observation: Mapping[str, "np.ndarray"], row: int) -> dict[str, "np.ndarray"]:
    """A row's part of the observation of a batch."""
    return {name: values[row] for name, values in observation.items()}


@contextlib.contextmanager
def _failures_reported(path: Path) -> Iterator[None]:
    """Turns what cuts a film short into one line and an exit status."""
    from limberjack.mujoco.camera import RenderingError
    from limberjack.policies import PolicyError
    from limberjack.rl.control import PhysicsError

    try:
        yield
    except KeyboardInterrupt:
        complain(f"interrupted: {path} is not written")
        raise typer.Exit(INTERRUPTED) from None
    except (ImportError, OSError, PhysicsError, PolicyError, RenderingError) as error:
        complain(f"no {path}: {error}")
        raise typer.Exit(FAILED) from None
