"""`record` and `film`: films of episodes, alone or side by side; `pictures`: those of a dataset.

    record("humanoid", "walk", out="walk.mp4", policy="random")
    record(my_package.make, out="mine.gif", seconds=5.0, rows=4)     # make(seed) -> Environment
    film(data.load("walk"), 3, out="walk-3.mp4", overlay=True)       # an episode of a dataset
    pictures(data.load("walk"), 3, Pixels(camera="side"))            # (T + 1, 84, 84, 3)

The command is `limberjack record`. Films are MP4 or GIF, play in real time, and are written
completely or not at all. They need the extra `video` and OpenGL. `limberjack.see.video` films other
simulations.
"""

import contextlib
import functools
import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NotRequired, TypedDict, Unpack

import dm_env
import numpy as np
from dm_env import specs

from limberjack import policies
from limberjack.episodes.environments import checked_repeat, inside
from limberjack.episodes.episode import Episode
from limberjack.episodes.playing import Step, play, recorded
from limberjack.episodes.recipe import Recipe, environments_of, other_versions
from limberjack.mujoco import TextOverlay
from limberjack.mujoco.simulation import STATE
from limberjack.policies import ROWS, Act, Actor
from limberjack.policies.actors import EachRow
from limberjack.policies.named import is_stateful_object
from limberjack.rl.guards import at_least_one
from limberjack.rl.pixels import Pixels
from limberjack.rl.rows import RowsEnvironment
from limberjack.see.report.result import FILM, RESULT
from limberjack.see.video import SIZE, Film, first_camera, mosaic
from limberjack.utils.files import Hold, open_regular
from limberjack.utils.seeds import SEEDS, checked_seed
from limberjack.workers.factories import Factory, Make, factory_of
from limberjack.worlds import World

if TYPE_CHECKING:
    from limberjack.episodes.dataset import Dataset  # which needs the extra 'data'

__all__ = ["DepartedError", "View", "drawable", "film", "pictures", "record"]

_LARGEST = 2160, 3840  # height and width of a picture, pixels; beyond it memory may run out
_TABLE_WIDTH = 320  # pixels; on narrower pictures a table of three lines would cover too much

_FTYP = slice(4, 8)  # bytes of an MP4 that name its first part

# Called with steps so far, steps in all and the return so far, of several episodes the mean.
_OnProgress = Callable[[int, int, float], object]


class DepartedError(ValueError):
    """A recorded episode that is played again is another one here; there is no film of it."""


class View(TypedDict):
    """Appearance of a film; the attributes are arguments of `record`."""

    camera: NotRequired[int | str]
    height: NotRequired[int]
    width: NotRequired[int]
    overlay: NotRequired[bool]
    visualize_reward: NotRequired[bool]


def record(
    domain: str | Make,
    task: str | None = None,
    *,
    out: Path | str,
    policy: object = "zero",
    seed: int = 0,
    seconds: float | None = None,
    rows: int = 1,
    action_repeat: int | None = None,
    world: World | None = None,
    on_progress: _OnProgress | None = None,
    **view: Unpack[View],
) -> Path:
    """Films an episode of a task, or several side by side.

    Args:
      domain: a name such as 'humanoid', or a function `make(seed) -> dm_env.Environment`.
      task: such as 'walk'; None with a function.
      out: the file, which ends in .mp4 or .gif; an earlier one is replaced.
      policy: its name, or the function, object or class itself; see `limberjack.policies`.
      seed: of the episode; row i has seed + i.
      seconds: of simulated time; by default the task's time limit.
      rows: number of episodes side by side, at most 64. One that ends early keeps its last picture.
      action_repeat: control steps per action; None for the environment's own.
      world: options such as {'faults': 'easy'}, see `limberjack.worlds`; None with a function.
      on_progress: called before the episode begins and after each step, with the steps so far,
        those in all, and the return so far (of several episodes the mean).
      view: camera (its number or name; -1 is the free camera; by default the model's first one, or
        the free camera if it has none), height and width (of the film, all
        rows together, pixels; 480 and 640 by default), overlay (draw time, reward and return in a
        corner), visualize_reward (colour the bodies by the reward).

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
    if rows > ROWS:
        raise ValueError(f"rows is {rows}; expected at most {ROWS} episodes side by side")
    if first + rows > SEEDS:
        raise ValueError(f"the last row's seed is {first + rows - 1}; expected below {SEEDS}")
    if seconds is not None and not (math.isfinite(seconds) and seconds > 0):
        raise ValueError(f"seconds is {seconds}; expected a positive number of seconds")
    # Episodes of the suite may be longer than the task's own time limit.
    factory = factory_of(domain, task, None if callable(domain) else seconds, world)
    if action_repeat is None and callable(domain):
        with contextlib.closing(factory.make(first)) as one:
            own = inside(one)._ours.action_repeat
            action_repeat = None if own == 1 else own  # 1 leaves it to the policy
    with _Stage.of(factory, first, rows, seconds, view) as stage, _held(path):
        actor = _actor_of_rows(policy, stage.batch, first)
        repeat = checked_repeat(action_repeat, stage.batch.environments[0], actor)
        stage.film(path, actor, range(first, first + rows), on_progress, repeat)
    return path


def film(
    dataset: "Dataset",
    seed: int,
    make: Make | None = None,
    *,
    out: Path | str,
    on_progress: _OnProgress | None = None,
    **view: Unpack[View],
) -> Path:
    """Films an episode of a dataset, from its states, or from its seed and actions.

    States are shown as they were recorded, with any version of MuJoCo. Without them the episode is
    simulated again, and a film of other rewards than the recorded ones is refused.

    Args:
      dataset: of a domain that is known here, or of environments that `make` makes.
      seed: of the episode.
      make: as for `limberjack.data.replay`.
      out: the file, which ends in .mp4 or .gif.
      on_progress: called before the episode begins and after each step.
      view: as for `record`.

    Raises:
      DepartedError: the episode is another one here.
      ValueError: there is no such episode, or see `record`.
      ImportError, OSError, PhysicsError, RenderingError: see `record`.
    """
    if seed not in dataset.seeds:
        raise ValueError(f"there is no episode of seed {seed}; the first is {dataset.seeds[0]}")
    path = _checked_path(Path(out))
    episode, recipe = dataset.episode(seed), dataset.recipe
    environment, made = environments_of(recipe, make)
    environment.close()
    factory = Factory("the recorded episode", {}, made.make)
    with _Stage.of(factory, seed, 1, None, view) as stage, _held(path):
        stage.step_limit = episode.length
        if episode.states is not None:
            stage.show(path, episode.states, episode.rewards, on_progress)
            return path
        actor = recorded({seed: episode.actions})
        check = functools.partial(_check_same, recorded=episode, recipe=recipe)
        stage.film(path, actor, [seed], on_progress, on_ended=check)
    return path


def _check_same(found: Episode, recorded: Episode, recipe: Recipe) -> None:
    """Raises DepartedError unless an episode that was played again has the recorded rewards."""
    if not np.array_equal(found.rewards, recorded.rewards, equal_nan=True):
        raise DepartedError(
            f"the episode of seed {recorded.seed} has other rewards here, with return "
            f"{found.total} in {found.length} steps, than in the dataset, with return "
            f"{recorded.total} in {recorded.length}: with --states it could be filmed with other "
            f"versions.{other_versions(recipe, None)}"
        )


def _held(path: Path) -> Hold:
    return Hold(path.parent if path.name == FILM else path)


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


def _actor_of_rows(policy: object, batch: RowsEnvironment, first_seed: int) -> Actor:
    """The actor for all rows of a batch, whose seeds follow each other.

    Raises:
      ValueError: there is no such policy, or it cannot act in several rows.
    """
    first = policies.find(policy, batch.environments[0])
    if batch.num_envs == 1:
        return first
    if not policies.is_saved_model(policy) and is_stateful_object(policy):
        raise ValueError(
            f"policy {first.name!r} is an object with the state of one episode: give its class, so "
            "that each row has an object of its own"
        )
    if not first.plays_alone:
        return first
    actors = [first, *(policies.find(policy, one) for one in batch.environments[1:])]

    def begin(spec: specs.BoundedArray, seed: int) -> Act:
        row = seed - first_seed
        return actors[row].begin_alone(batch.environments[row], seed)

    actor = EachRow(first.name, first.sha256, begin)
    actor.action_repeat = first.action_repeat
    return actor


def pictures(
    dataset: "Dataset", seed: int, pixels: Pixels | None = None, make: Make | None = None
) -> np.ndarray:
    """The pictures before each step and after the last one, (T + 1, height, width, 3) uint8.

    They are drawn from the episode's states, and equal those that `collect --pixels` keeps, byte
    for byte with the same OpenGL; they need neither the policy nor the versions of the recipe.

    Args:
      dataset: with states, of a domain that is known here, or of environments that `make` makes.
      seed: of the episode.
      pixels: camera, size and quality; by default those of the pictures that the dataset keeps, or
        of `Pixels()`.
      make: as for `limberjack.data.replay`.

    Raises:
      KeyError: there is no such episode.
      ValueError: the dataset has no states, or there is no such camera; or see `replay`.
      RenderingError: OpenGL is not available.
    """
    if not dataset.recipe.kept.states:
        raise ValueError(
            "the dataset has no states to draw: collect it with states (--states), or film an "
            "episode, which simulates it again"
        )
    episode = dataset.episode(seed)
    assert episode.states is not None
    pixels = pixels or dataset.recipe.kept.pixels or Pixels()
    environment, factory = environments_of(dataset.recipe, make)
    environment.close()
    with contextlib.closing(factory.make(seed)) as one:
        one.reset()  # draws the model fields
        physics = inside(one).physics
        drawn = []
        for state in episode.states:
            physics.set_state(state, STATE)
            physics.forward()
            drawn.append(physics.render(**pixels.render_kwargs))
    return np.stack(drawn)


def drawable(make: Make, height: int, width: int, visualize_reward: bool = False) -> Make:
    """A function that makes the same environments, of which pictures of a size can be drawn.

    Args:
      make: makes environments with a `control.Environment` inside.
      height, width: pixels; a model's off-screen buffer may be smaller, and is enlarged.
      visualize_reward: colour the bodies by the reward.

    What is made raises ValueError if the task cannot colour them.
    """
    most_height, most_width = _LARGEST

    def made(seed: int) -> dm_env.Environment:
        environment = make(seed)
        inner = inside(environment)
        buffer = inner.physics.model.vis.global_
        buffer.offheight = max(buffer.offheight, min(height, most_height))
        buffer.offwidth = max(buffer.offwidth, min(width, most_width))
        if visualize_reward:
            _colour(inner.task)
        return environment

    return made


def _colour(task: object) -> None:
    """Makes a task colour the bodies by the reward."""
    if not hasattr(task, "visualize_reward"):
        raise ValueError(
            f"visualize_reward is set, but the task {type(task).__name__} colours nothing; "
            "expected one that inherits from limberjack.suite.base.Task"
        )
    task.visualize_reward = True  # pyright: ignore[reportAttributeAccessIssue]


class _Stage:
    """Environments that are drawn, one or several side by side.

    Attributes:
      batch: complete environments, one for each picture.
      step_limit: steps of the film.
    """

    def __init__(self, batch: RowsEnvironment, step_limit: int, view: View) -> None:
        """Draws a picture, so that what cannot be drawn is refused before an episode begins.

        Raises:
          ValueError: there is no such camera, or the size is too large.
          RenderingError: OpenGL is not available.
        """
        self.batch = batch
        self.step_limit = step_limit
        model = inside(batch.environments[0]).physics.model
        self._camera = view.get("camera", first_camera(model))
        self._overlay = view.get("overlay", False)
        self._size, self._picture_size = _sizes(batch.num_envs, view)
        self._render(0)
        self._last = [np.zeros(0, np.uint8)] * batch.num_envs  # pictures of the rows

    @classmethod
    @contextlib.contextmanager
    def of(
        cls, factory: Factory, seed: int, rows: int, seconds: float | None, view: View
    ) -> "Iterator[_Stage]":
        """A stage for so many episodes.

        Raises:
          ValueError: the film would never end, its size is too small for the rows, or see
            `__init__`.
        """
        how = {"seed": seed, "on_divergence": "raise", "action_repeat": 1}
        _, size = _sizes(rows, view)
        make = drawable(factory.make, *size, view.get("visualize_reward", False))
        batch = RowsEnvironment(make, rows, **how)
        with contextlib.closing(batch):
            limit = batch.step_limit
            if seconds is not None:
                limit = min(limit, max(1, math.ceil(seconds / batch.control_timestep() - 1e-9)))
            if math.isinf(limit):
                raise ValueError(
                    f"{factory.title} has no time limit, so the film would never end: give its "
                    "seconds (--seconds SECONDS)"
                )
            yield cls(batch, math.ceil(limit), view)

    def film(
        self,
        path: Path,
        actor: Actor,
        seeds: Sequence[int],
        on_progress: _OnProgress | None,
        action_repeat: int = 1,
        on_ended: Callable[[Episode], object] = lambda _: None,
    ) -> None:
        """Films an episode of each row, unless `on_ended` raises an error for one."""
        with self._begun(path) as film:

            def on_step(step: Step) -> None:
                if on_progress is not None:
                    number, mean = int(step.numbers.max()), float(step.totals.mean())
                    on_progress(number, self.step_limit, mean)
                film.add_picture(lambda: self._pictures(step))

            how = {"most_steps": self.step_limit, "on_step": on_step}
            for ended in play(self.batch, actor, seeds, action_repeat=action_repeat, **how):
                for episode in ended:
                    on_ended(episode)

    def show(
        self,
        path: Path,
        states: np.ndarray,
        rewards: np.ndarray,
        on_progress: _OnProgress | None,
    ) -> None:
        """Films states that were recorded, without simulating."""
        environment = inside(self.batch.environments[0])
        environment.reset()  # draws the model fields
        with self._begun(path) as film:
            total = 0.0
            for step, (state, reward) in enumerate(zip(states, [0.0, *rewards], strict=True)):
                total += float(reward)
                if on_progress is not None:
                    on_progress(step, len(rewards), total)
                environment.physics.set_state(state, STATE)
                environment.physics.forward()
                environment.task.after_step(environment.physics)  # sets the colours, if wanted
                film.add_picture(lambda r=reward, s=step, t=total: self._picture(0, s, float(r), t))

    @contextlib.contextmanager
    def _begun(self, path: Path) -> Iterator[Film]:
        """A film, which is finished with the context; raises what `Film` does."""
        height, width = self._size
        film = Film(path, self.batch.control_timestep(), height=height, width=width)
        try:
            yield film
            film.finish()
        finally:
            film.discard()

    def _pictures(self, step: Step) -> np.ndarray:
        """The pictures of all rows; those whose episodes have ended keep their last one."""
        for row in step.rows.tolist():
            reward = 0.0 if step.actions is None else float(step.time_step.reward[row])
            number, total = int(step.numbers[row]), float(step.totals[row])
            self._last[row] = self._picture(row, number, reward, total)
        return self._last[0] if len(self._last) == 1 else mosaic(self._last)

    def _picture(self, row: int, steps: int, reward: float, total: float) -> np.ndarray:
        overlays = []
        if self._overlay:
            time = f"{steps * self.batch.control_timestep():.2f} s"
            names, values = "time\nreward\nreturn", f"{time}\n{reward:.3f}\n{total:.1f}"
            if self._picture_size[1] < _TABLE_WIDTH:
                names, values = time, f"{reward:.3f}"
            overlays = [TextOverlay(names, values, position="bottom left")]
        return self._render(row, overlays)

    def _render(self, row: int, overlays: Sequence[TextOverlay] = ()) -> np.ndarray:
        physics = inside(self.batch.environments[row]).physics
        return physics.render(*self._picture_size, camera_id=self._camera, overlays=list(overlays))


def _sizes(rows: int, view: View) -> tuple[tuple[int, int], tuple[int, int]]:
    """Height and width of a film, and of the picture of each row.

    Raises:
      ValueError: the film is too small for the rows.
    """
    height, width = view.get("height", SIZE[0]), view.get("width", SIZE[1])
    across = math.ceil(math.sqrt(rows))
    down = math.ceil(rows / across)
    # Even numbers, which H.264 needs.
    picture = height // down // 2 * 2, width // across // 2 * 2
    if 0 in picture:
        raise ValueError(f"a film of {height}x{width} pixels is too small for {rows} rows")
    if rows == 1:
        return (height, width), (height, width)
    return (picture[0] * down, picture[1] * across), picture
