"""Rendering speed, compared with a bare `mujoco.Renderer` and dm_control.

    python benchmarks/rendering.py [--quick] [--json FILE]

All render the same states in turns, in one process, and the pictures must be equal. README.md
describes the comparisons. The exit status is 1 if a bar is missed.
"""

import dataclasses
import os
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import peers
import typer
from report import Bar, Json, Quick, Row, at_least, compared, finish, rates

from limberjack.mujoco import rendering
from limberjack.mujoco.official import mujoco

__all__ = ["Effort", "main"]

_TASKS = (("humanoid", "walk"), ("manipulator", "bring_ball"), ("stacker", "stack_4"))
_SMALL, _LARGE = (84, 84), (480, 640)
_SIZES = (_SMALL, _LARGE)
_SOFTWARE = ("llvmpipe", "softpipe", "swrast")
_SEED = 0

# Frames per second over those of a bare `mujoco.Renderer`.
_OF_BARE = at_least(0.95)
# Over dm_control, which creates a scene for each frame; this matters little for large frames.
_OF_THEIRS = {_SMALL: at_least(1.8), _LARGE: at_least(1.0)}
# Of quality 'fast' over 'full', with a software renderer.
_FAST = at_least(2.5)
# Of a batch's rows over bare renders of the same.
_OF_BARE_ROWS = at_least(0.9)
# Of a batch's rows over single environments, one after the other, on two cores with a software
# renderer.
_OF_LOOP, _QUALITIES = at_least(1.3), ("fast", "full")

_OURS, _BARE, _QUICKER, _DEPTH, _LOOP = "ours", "bare", "fast", "depth", "loop"

# Renders the current state.
_Player = Callable[[], np.ndarray]


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work."""

    rounds: int  # states of each task, at the small size
    large_rounds: int  # at the large one
    frames: int  # of each state, by each
    tasks: int
    rows: int  # of the batch
    many_rows: int  # of the batch beside a loop


_FULL = Effort(rounds=40, large_rounds=20, frames=3, tasks=len(_TASKS), rows=16, many_rows=64)
# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(rounds=1, large_rounds=1, frames=1, tasks=1, rows=2, many_rows=3)


def main(
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure pictures and print each bar and whether it is met."""
    if sys.platform == "linux":
        os.environ.setdefault("MUJOCO_GL", "egl")  # otherwise the others look for a window
    effort = _QUICK if quick else _FULL
    if peers.THEIRS not in peers.installed():
        typer.echo("dm_control is not installed: comparisons with it are not measured.", err=True)
    rows = []
    for task in _TASKS[: effort.tasks]:
        typer.echo(f"measuring: {':'.join(task)}", err=True)
        rows += _of_singles(task, effort) + _of_batches(task, effort) + _of_loops(task, effort)
    rows.sort(key=lambda row: [name for name, _ in _MEASURES].index(row.measure))
    renderer = _renderer()
    typer.echo(f"drawn by {renderer}")
    settings = {"renderer": renderer, **dataclasses.asdict(effort)}
    finish(rows, "the other", quick, json, settings)


# The table's parts, in order, and the two quantities of each ratio.
_MEASURES = (
    ("render / mujoco.Renderer", (_OURS, _BARE)),
    ("render / dm_control", (_OURS, peers.THEIRS)),
    ("fast / full", (_QUICKER, _OURS)),
    ("depth / colours", (_DEPTH, _OURS)),
    ("batch / mujoco.Renderer", (_OURS, _BARE)),
    ("batch / loop", (_OURS, _LOOP)),
)


def _of_singles(task: tuple[str, str], effort: Effort) -> list[Row]:
    """The rows of one task's single environments, at each size."""
    rows = []
    for size in _SIZES:
        rounds = effort.rounds if size == _SMALL else effort.large_rounds
        taken = _Single(task, size).play(rounds, effort.frames)
        bars: tuple[Bar | None, ...]
        is_software = any(name in _renderer() for name in _SOFTWARE)
        bars = _OF_BARE, _OF_THEIRS[size], _FAST if is_software and size == _SMALL else None, None
        for (measure, (upper, lower)), bar in zip(_MEASURES, bars, strict=False):
            subject = f"{':'.join(task)} {size[0]}x{size[1]}"
            rows.append(_row(measure, subject, taken, (upper, lower), bar))
    return rows


def _of_batches(task: tuple[str, str], effort: Effort) -> list[Row]:
    """The row of one task's batch, at the small size."""
    measure, (upper, lower) = _MEASURES[-2]
    rounds = max(1, effort.rounds // effort.rows * 4)
    taken = _Batch(task, _SMALL, effort.rows).play(rounds, 1)
    subject = f"{':'.join(task)} {effort.rows} x {_SMALL[0]}x{_SMALL[1]}"
    per_frame = {name: [s / effort.rows for s in seconds] for name, seconds in taken.items()}
    return [_row(measure, subject, per_frame, (upper, lower), _OF_BARE_ROWS)]


def _of_loops(task: tuple[str, str], effort: Effort) -> list[Row]:
    """The rows of one task's batch beside as many single environments, in each quality."""
    measure, (upper, lower) = _MEASURES[-1]
    count, is_software = effort.many_rows, any(name in _renderer() for name in _SOFTWARE)
    rows = []
    for quality in _QUALITIES:
        taken = _Loop(task, _SMALL, count, quality).play(max(1, effort.rounds // 5), 1)
        subject = f"{':'.join(task)} {count} x {_SMALL[0]}x{_SMALL[1]} {quality}"
        per_frame = {name: [s / count for s in seconds] for name, seconds in taken.items()}
        given = per_frame, (upper, lower), _OF_LOOP if is_software else None
        rows.append(_row(measure, subject, *given))
    return rows


def _row(
    measure: str,
    subject: str,
    taken: Mapping[str, list[float]],
    names: tuple[str, str],
    bar: Bar | None,
) -> Row:
    """The speedup of the first of two players over the second, from their times."""
    first, second = (rates(taken.get(name, [])) for name in names)
    return compared(measure, subject, first, second, "/s", bar)


class _Contest:
    """Players that render the same states in turns."""

    players: dict[str, _Player]
    # Players whose pictures must be equal.
    alike: tuple[str, ...]

    def advance(self) -> None:
        """Advances all players to the next state."""
        raise NotImplementedError

    def play(self, rounds: int, frames: int) -> dict[str, list[float]]:
        """Seconds per frame of each player in each round, of the same state."""
        order = list(self.players)
        taken: dict[str, list[float]] = {name: [] for name in order}
        for number in range(rounds + 1):
            self.advance()
            if number == 0:  # not timed: resources are created for the first picture
                self._check({name: play() for name, play in self.players.items()})
                continue
            for name in order:
                start = time.perf_counter()
                for _ in range(frames):
                    self.players[name]()
                taken[name].append((time.perf_counter() - start) / frames)
            order.append(order.pop(0))
        return taken

    def _check(self, pictures: Mapping[str, np.ndarray]) -> None:
        alike = [pictures[name] for name in self.alike if name in pictures]
        if not all(np.array_equal(alike[0], picture) for picture in alike):
            raise RuntimeError(f"{type(self).__name__}: the pictures are not equal")


class _Single(_Contest):
    """One environment, rendered by Limberjack, a bare `mujoco.Renderer` and dm_control."""

    alike = (_OURS, _BARE, peers.THEIRS)

    def __init__(self, task: tuple[str, str], size: tuple[int, int]) -> None:
        self._environments = {
            package: peers.suite(package, draws=True).load(*task, {"random": _SEED})
            for package in peers.installed()
        }
        for environment in self._environments.values():
            environment.reset()
        ours = self._environments[peers.OURS]
        self._random = np.random.RandomState(_SEED)
        self._spec = ours.action_spec()
        model, self._data = ours.physics.model._official, ours.physics.data._data
        self.players = {
            _OURS: _drawing(ours, *size),
            _BARE: _bare(model, self._data, *size),
            _QUICKER: _drawing(ours, *size, quality="fast"),
            _DEPTH: _drawing(ours, *size, depth=True),
        }
        if peers.THEIRS in self._environments:
            self.players[peers.THEIRS] = _drawing(self._environments[peers.THEIRS], *size)

    def advance(self) -> None:
        action = self._random.uniform(self._spec.minimum, self._spec.maximum)
        for environment in self._environments.values():
            environment.step(action)


class _Batch(_Contest):
    """A batch's rows, rendered by `BatchEnvironment` and by a bare `mujoco.Renderer`."""

    # A bare renderer ignores per-row model fields, so it draws other targets.
    alike = ()

    def __init__(self, task: tuple[str, str], size: tuple[int, int], rows: int) -> None:
        self._batch = peers.suite(peers.OURS).load_batch(*task, num_envs=rows, seed=_SEED)
        self._batch.reset()
        self._random = np.random.RandomState(_SEED)
        physics: Any = self._batch.physics
        model, official = physics.simulation.model._official, physics.simulation._official
        data = mujoco.MjData(model)
        draw = _bare(model, data, *size)

        def draw_rows() -> np.ndarray:
            pictures = []
            for row in range(rows):
                official.get_data(row, data)
                pictures.append(draw())
            return np.stack(pictures)

        height, width = size
        self.players = {
            _OURS: lambda: self._batch.render(height=height, width=width, camera_id=0),
            _BARE: draw_rows,
        }
        if task[0] == "humanoid":
            self.alike = (_OURS, _BARE)

    def advance(self) -> None:
        self._batch.step(self._random.uniform(-1, 1, self._batch.action_spec().shape))


class _Loop(_Contest):
    """A batch's rows, rendered by `BatchEnvironment`, and single environments in turn."""

    alike = (_OURS, _LOOP)

    def __init__(
        self, task: tuple[str, str], size: tuple[int, int], rows: int, quality: str
    ) -> None:
        suite = peers.suite(peers.OURS, draws=True)
        self._batch = suite.load_batch(*task, num_envs=rows, seed=_SEED)
        self._singles = [suite.load(*task, {"random": _SEED + row}) for row in range(rows)]
        for each in (self._batch, *self._singles):
            each.reset()
        self._random = np.random.RandomState(_SEED)
        height, width = size
        how: dict[str, Any] = {"camera_id": 0, "quality": quality}
        drawn = [_drawing(single, height, width, quality=quality) for single in self._singles]
        self.players = {
            _OURS: lambda: self._batch.render(height=height, width=width, **how),
            _LOOP: lambda: np.stack([draw() for draw in drawn]),
        }

    def advance(self) -> None:
        actions = self._random.uniform(-1, 1, self._batch.action_spec().shape)
        self._batch.step(actions)
        for single, action in zip(self._singles, actions, strict=True):
            single.step(action)


def _drawing(environment: Any, height: int, width: int, **how: Any) -> _Player:
    render = environment.physics.render
    return lambda: render(height, width, camera_id=0, **how)


def _bare(model: Any, data: Any, height: int, width: int) -> _Player:
    """MuJoCo's own renderer for a state."""
    renderer = mujoco.Renderer(model, height, width)

    def draw() -> np.ndarray:
        renderer.update_scene(data, camera=0)
        return renderer.render()

    return draw


def _renderer() -> str:
    backend = rendering.backend()
    return backend.renderer if backend is not None else ""


if __name__ == "__main__":
    typer.run(main)
