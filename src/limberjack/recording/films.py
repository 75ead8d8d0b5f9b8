"""`record`: a film of an episode, or of a batch side by side, as MP4 or GIF.

    record("humanoid", "walk", out="walk.mp4", policy="random")
    record(my_package.make, out="mine.gif", seconds=5.0, rows=4)     # make(seed) -> Environment

The command is `limberjack record`. Films play in real time, and are written completely or not at
all. They need the extra `video` and OpenGL. `limberjack.video` films other simulations.
"""

import contextlib
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path

import dm_env
import numpy as np

from limberjack import policies, rollout
from limberjack.factories import Factory, Make, factory_of
from limberjack.mujoco import TextOverlay
from limberjack.mujoco.simulation import STATE
from limberjack.policies import Act, EnvironmentPolicy, Policy
from limberjack.policies.named import is_stateful_object
from limberjack.report.folder import FILM, RESULT
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.control import Environment
from limberjack.rl.guards import at_least_one
from limberjack.utils.files import Hold
from limberjack.utils.regular import open_regular
from limberjack.utils.seeds import SEEDS, checked_seed
from limberjack.video import Film, mosaic

__all__ = ["record", "record_states"]

_LARGEST = 2160, 3840  # height and width of a picture, pixels; beyond it memory may run out
_TABLE_WIDTH = 320  # pixels; on narrower pictures a table of three lines would cover too much

_FTYP = slice(4, 8)  # bytes of an MP4 that name its first part

# Called with steps so far, steps in all and the return so far, of a batch the mean.
_OnProgress = Callable[[int, int, float], object]


def record(
    domain: str | Make,
    task: str | None = None,
    *,
    out: Path | str,
    policy: object = "zero",
    seed: int = 0,
    camera: int | str = 0,
    height: int = 480,
    width: int = 640,
    seconds: float | None = None,
    rows: int = 1,
    overlay: bool = False,
    visualize_reward: bool = False,
    on_progress: _OnProgress | None = None,
) -> Path:
    """Films an episode of a task, or one of each row of a batch.

    Args:
      domain: a name such as 'humanoid', or a function `make(seed) -> control.Environment`.
      task: such as 'walk'; None with a function.
      out: the file, which ends in .mp4 or .gif; an earlier one is replaced.
      policy: its name, or the function, object or class itself; see `limberjack.policies`.
      seed: of the episode; row i has seed + i.
      camera: its number or name; -1 is the free camera.
      height: of the film, all rows together, pixels.
      width: of the film, all rows together, pixels.
      seconds: of simulated time; by default the task's time limit.
      rows: number of episodes side by side.
      overlay: draw time, reward and return in a corner.
      visualize_reward: colour the bodies by the reward.
      on_progress: called before the episode begins and after each step, with the steps so far,
        those in all, and the return so far (of rows the mean).

    Returns:
      The file.

    Raises:
      ValueError, TypeError: an argument is wrong, another process writes to `out`, or `out` is the
        film of a run or an existing file that is no film; nothing was filmed.
      PolicyError, PhysicsError: the policy or the simulation failed; there is no film.
      ImportError: the extra `video` is missing.
      RenderingError: OpenGL is not available.
      OSError: the film cannot be written.
    """
    path = _checked_path(Path(out))
    first = checked_seed(seed)
    rows = at_least_one("rows", rows)
    if first + rows > SEEDS:
        raise ValueError(f"the last row's seed is {first + rows - 1}; expected below {SEEDS}")
    stage = _Stage(_factory(domain, task, seconds), first, seconds, visualize_reward)
    with contextlib.closing(stage), Hold(path.parent if path.name == FILM else path):
        chosen = stage.policies(policy, rows)
        stage.set_view(camera, height, width, rows, overlay)
        stage.begin_film(path)
        if on_progress is not None:
            on_progress(0, stage.step_limit, 0.0)
        if rows == 1:
            stage.play(chosen[0], on_progress)
        else:
            stage.play_batch(chosen, on_progress)
        stage.finish_film()
    return path


def record_states(
    environment: Environment,
    states: np.ndarray,
    rewards: np.ndarray,
    *,
    out: Path | str,
    camera: int | str = 0,
    height: int = 480,
    width: int = 640,
    overlay: bool = False,
    visualize_reward: bool = False,
    on_progress: _OnProgress | None = None,
) -> Path:
    """Films states that were recorded, without simulating.

    Args:
      environment: at the start of the episode, whose model fields it has; it is closed.
      states: MuJoCo's integration states, (T + 1, nstate).
      rewards: of the steps between them, (T,).
      out, camera, height, width, overlay, visualize_reward, on_progress: as for `record`.

    Raises:
      ValueError, ImportError, RenderingError, OSError: as `record`.
    """
    factory = Factory("the recorded episode", {}, lambda seed: environment)
    with contextlib.closing(_Stage(factory, 0, None, visualize_reward)) as stage:
        path = _checked_path(Path(out))
        with Hold(path.parent if path.name == FILM else path):
            stage.set_view(camera, height, width, 1, overlay)
            stage.begin_film(path)
            stage.show(states, rewards, on_progress)
            stage.finish_film()
    return path


def _factory(domain: str | Make, task: str | None, seconds: float | None) -> Factory:
    """The factory of the environments; those of the suite may exceed their own time limit."""
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
        raise ValueError(f"seconds is {seconds}; expected a positive number of seconds")
    return factory_of(domain, task, None if callable(domain) else seconds)


def _checked_path(path: Path) -> Path:
    if not path.parent.is_dir():
        raise ValueError(f"the film is {path}; there is no directory {path.parent}")
    if path.is_dir():
        raise ValueError(f"the film is {path}, a directory; expected a file's name")
    if path.name == FILM and (path.parent / RESULT).exists():
        raise ValueError(
            f"the film is {path}, and that folder's {RESULT} belongs to its present {FILM}: choose "
            "another name or folder"
        )
    if os.path.lexists(path):
        _check_is_film(path)
    return path.absolute()  # a policy may change the working directory


def _check_is_film(path: Path) -> None:
    """Raises ValueError if a file that a film is to replace is no film; OSError if unreadable."""
    with open_regular(path) as file:
        beginning = file.read(_FTYP.stop)
    if beginning and beginning[_FTYP] != b"ftyp" and not beginning.startswith(b"GIF8"):
        raise ValueError(
            f"the film is {path}, and the file of that name is no film: choose another name, or "
            "remove that file"
        )


class _Stage:
    """An environment that is drawn, alone or in the place of each row of a batch."""

    def __init__(
        self, factory: Factory, seed: int, seconds: float | None, visualize_reward: bool
    ) -> None:
        """Makes the environment; raises ValueError if the film would never end."""
        self._seed = seed
        self._factory = factory
        self._environment = factory.make_plain(seed)
        self._film: Film | None = None
        limit = self._environment.step_limit
        if seconds is not None:
            wanted = max(1, math.ceil(seconds / self._environment.control_timestep() - 1e-9))
            limit = wanted if limit is None else min(limit, wanted)
        if limit is None:
            self._environment.close()
            raise ValueError(
                f"{factory.title} has no time limit, so the film would never end: give its seconds "
                "(--seconds SECONDS)"
            )
        self.step_limit = limit
        if visualize_reward:
            self._environment.task.visualize_reward = True

    def policies(self, policy: object, rows: int) -> list[Policy]:
        """The policy of each row; if it is a class, each row has an object of its own.

        Raises:
          ValueError: there is no such policy, or it cannot act in several rows.
        """
        first = policies.find(policy, self._environment)
        if rows > 1 and isinstance(first, EnvironmentPolicy):
            raise ValueError(f"policy {policy!r} acts in one environment; leave out the rows")
        if policies.is_saved_model(policy):  # loaded once; its episodes are independent
            return [first] * rows
        if rows > 1 and is_stateful_object(policy):
            name = policy if isinstance(policy, str) else policies.name_of(policy)
            raise ValueError(
                f"policy {name!r} is an object with the state of one episode: give its class, so "
                "that each row has an object of its own"
            )
        return [first, *(policies.find(policy) for _ in range(rows - 1))]

    def set_view(
        self, camera: int | str, height: int, width: int, rows: int, overlay: bool
    ) -> None:
        """Sets how the environment is drawn, and draws it once.

        Raises:
          ValueError: there is no such camera, or the size is too large, or too small for the rows.
          RenderingError: OpenGL is not available.
        """
        across = math.ceil(math.sqrt(rows))
        down = math.ceil(rows / across)
        # Even numbers, which H.264 needs.
        picture = height // down // 2 * 2, width // across // 2 * 2
        if 0 in picture:
            raise ValueError(f"a film of {height}x{width} pixels is too small for {rows} rows")
        if rows > 1:
            height, width = picture[0] * down, picture[1] * across
        self._size = height, width
        self._picture_size = height // down, width // across
        self._camera = camera
        self._overlay = overlay
        # The suite's models have a buffer of 480 by 640; no other environment has this model.
        buffer, (most_height, most_width) = self._environment.physics.model.vis.global_, _LARGEST
        buffer.offheight = max(buffer.offheight, min(self._picture_size[0], most_height))
        buffer.offwidth = max(buffer.offwidth, min(self._picture_size[1], most_width))
        self._environment.physics.render(*self._picture_size, camera_id=camera)

    def begin_film(self, path: Path) -> None:
        """Begins the film; raises ImportError, OSError or ValueError if that is impossible."""
        height, width = self._size
        timestep = self._environment.control_timestep()
        self._film = Film(path, timestep, height=height, width=width)

    def finish_film(self) -> None:
        assert self._film is not None
        self._film.finish()

    def close(self) -> None:
        """Frees the environment and removes an unfinished film."""
        if self._film is not None:
            self._film.discard()
        self._environment.close()

    def play(self, policy: Policy, on_progress: _OnProgress | None) -> None:
        """Films an episode."""
        film = self._film
        assert film is not None

        def on_step(step: rollout.Step) -> None:
            if on_progress is not None and step.number:
                on_progress(step.number, self.step_limit, step.total)
            film.add_picture(lambda: self._picture(step.number, step.reward, step.total))

        rollout.run_episode(self._environment, policy, self._seed, on_step, self.step_limit)

    def show(
        self, states: np.ndarray, rewards: np.ndarray, on_progress: _OnProgress | None
    ) -> None:
        """Films states that were recorded."""
        film, environment = self._film, self._environment
        assert film is not None
        total = 0.0
        for step, (state, reward) in enumerate(zip(states, [0.0, *rewards], strict=True)):
            total += float(reward)
            if on_progress is not None:
                on_progress(step, len(rewards), total)
            environment.physics.set_state(state, STATE)
            environment.physics.forward()
            environment.task.after_step(environment.physics)  # sets the colours, if wanted
            film.add_picture(lambda r=reward, s=step, t=total: self._picture(s, float(r), t))

    def play_batch(self, policies: list[Policy], on_progress: _OnProgress | None) -> None:
        """Films an episode of each row of a batch, side by side."""
        count, film = len(policies), self._film
        assert film is not None
        with contextlib.closing(self._factory.make_plain(self._seed)) as like:
            batch = BatchEnvironment.from_environment(like, count, seed=self._seed)
        spec = self._environment.action_spec()
        acts = [begin(spec, self._seed + row) for row, begin in enumerate(policies)]
        time_step, total = batch.reset(), np.zeros(count)

        def pictures(steps: int) -> np.ndarray:
            return mosaic([self._row(batch, row, steps, time_step, total) for row in range(count)])

        with contextlib.closing(batch):
            film.add_picture(lambda: pictures(0))
            for step in range(1, self.step_limit + 1):
                time_step = batch.step(_actions(acts, time_step.observation))
                total += time_step.reward
                if on_progress is not None:
                    on_progress(step, self.step_limit, float(total.mean()))
                film.add_picture(lambda steps=step: pictures(steps))

    def _row(
        self,
        batch: BatchEnvironment,
        row: int,
        steps: int,
        time_step: dm_env.TimeStep,
        total: np.ndarray,
    ) -> np.ndarray:
        """The picture of a row, drawn with a model that has no other row's colours."""
        environment = self._environment
        environment.restore(batch.snapshot([row]))
        environment.task.after_step(environment.physics)  # sets the colours, if they are wanted
        return self._picture(steps, float(np.asarray(time_step.reward)[row]), float(total[row]))

    def _picture(self, steps: int, reward: float, total: float) -> np.ndarray:
        overlays = []
        if self._overlay:
            time = f"{steps * self._environment.control_timestep():.2f} s"
            names, values = "time\nreward\nreturn", f"{time}\n{reward:.3f}\n{total:.1f}"
            if self._picture_size[1] < _TABLE_WIDTH:
                names, values = time, f"{reward:.3f}"
            overlays = [TextOverlay(names, values, position="bottom left")]
        return self._environment.physics.render(
            *self._picture_size, camera_id=self._camera, overlays=overlays
        )


def _actions(acts: list[Act], observation: Mapping[str, np.ndarray]) -> np.ndarray:
    """The actions of all rows."""
    rows = ({name: values[row] for name, values in observation.items()} for row in range(len(acts)))
    return np.stack([act(row) for act, row in zip(acts, rows, strict=True)])
