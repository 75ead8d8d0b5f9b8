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
    """The amount of work; by default that of a full run."""

    rounds: int = 40  # states of each task, at the small size
    large_rounds: int = 20  # at the large one
    frames: int = 3  # of each state, by each
    tasks: int = len(_TASKS)
    rows: int = 16  # of the batch
    many_rows: int = 64  # of the batch beside a loop


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(rounds=1, large_rounds=1, frames=1, tasks=1, rows=2, many_rows=3)


def main(
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure pictures and print each bar and whether it is met."""
    if sys.platform == "linux":
        os.environ.setdefault("MUJOCO_GL", "egl")  # otherwise the others look for a window
    effort = _QUICK if quick else Effort()
    if peers.THEIRS not in peers.installed():
        typer.echo("dm_control is not installed: comparisons with it are not measured.", err=True)
    rows = []
    for task in _TASKS[: effort.tasks]:
        typer.echo(f"measuring: {':'.join(task)}", err=True)
        rows += _of_singles(task, effort) + _of_batches(task, effort)
    rows.sort(key=lambda row: [*_MEASURES].index(row.measure))
    renderer = _renderer()
    typer.echo(f"drawn by {renderer}")
    settings = {"renderer": renderer, **dataclasses.asdict(effort)}
    finish(rows, "the other", quick, json, settings)


# The table's parts, in order, and the two quantities of each ratio.
_MEASURES = {
    "render / mujoco.Renderer": (_OURS, _BARE),
    "render / dm_control": (_OURS, peers.THEIRS),
    "fast / full": (_QUICKER, _OURS),
    "depth / colours": (_DEPTH, _OURS),
    "batch / mujoco.Renderer": (_OURS, _BARE),
    "batch / loop": (_OURS, _LOOP),
}


@dataclasses.dataclass(frozen=True)
class _Contest:
    """Players that render the same states in turns.

    Attributes:
      players: by name; each call draws `pictures`.
      advance: advances all of them to the next state.
      alike: players whose pictures must be equal.
      pictures: number of pictures that a player draws at once.
    """

    players: dict[str, _Player]
    advance: Callable[[], object]
    alike: tuple[str, ...]
    pictures: int = 1

    def play(self, rounds: int, frames: int = 1) -> dict[str, list[float]]:
        """Seconds per picture of each player in each round, of the same state."""
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
                taken[name].append((time.perf_counter() - start) / frames / self.pictures)
            order.append(order.pop(0))
        return taken

    def _check(self, pictures: Mapping[str, np.ndarray]) -> None:
        alike = [pictures[name] for name in self.alike if name in pictures]
        if not all(np.array_equal(alike[0], picture) for picture in alike):
            raise RuntimeError(f"the pictures of {' and '.join(self.alike)} are not equal")


def _of_singles(task: tuple[str, str], effort: Effort) -> list[Row]:
    """The rows of one task's single environments, at each size."""
    rows = []
    for size in _SIZES:
        rounds = effort.rounds if size == _SMALL else effort.large_rounds
        taken = _single(task, size).play(rounds, effort.frames)
        fast = _FAST if _is_drawn_by_software() and size == _SMALL else None
        subject = f"{':'.join(task)} {size[0]}x{size[1]}"
        bars = _OF_BARE, _OF_THEIRS[size], fast, None
        rows += [
            _row(measure, subject, taken, bar)
            for measure, bar in zip(_MEASURES, bars, strict=False)
        ]
    return rows


def _of_batches(task: tuple[str, str], effort: Effort) -> list[Row]:
    """The rows of one task's batches, at the small size."""
    title, size = ":".join(task), f"{_SMALL[0]}x{_SMALL[1]}"
    taken = _batch(task, effort.rows).play(max(1, effort.rounds // effort.rows * 4))
    subject = f"{title} {effort.rows} x {size}"
    rows = [_row("batch / mujoco.Renderer", subject, taken, _OF_BARE_ROWS)]
    bar = _OF_LOOP if _is_drawn_by_software() else None
    for quality in _QUALITIES:
        taken = _loop(task, effort.many_rows, quality).play(max(1, effort.rounds // 5))
        subject = f"{title} {effort.many_rows} x {size} {quality}"
        rows.append(_row("batch / loop", subject, taken, bar))
    return rows


def _row(measure: str, subject: str, taken: Mapping[str, list[float]], bar: Bar | None) -> Row:
    """The speedup of the first of the two players of a measure over the second."""
    first, second = (rates(taken.get(name, [])) for name in _MEASURES[measure])
    return compared(measure, subject, first, second, "/s", bar)


def _single(task: tuple[str, str], size: tuple[int, int]) -> _Contest:
    """One environment, rendered by Limberjack, a bare `mujoco.Renderer` and dm_control."""
    environments = {
        package: peers.suite(package, draws=True).load(*task, {"random": _SEED})
        for package in peers.installed()
    }
    for environment in environments.values():
        environment.reset()
    ours, random = environments[peers.OURS], np.random.RandomState(_SEED)
    spec, physics = ours.action_spec(), ours.physics

    def advance() -> None:
        action = random.uniform(spec.minimum, spec.maximum)
        for environment in environments.values():
            environment.step(action)

    players = {
        _OURS: _drawing(ours, *size),
        _BARE: _bare(physics.model._official, physics.data._data, *size),
        _QUICKER: _drawing(ours, *size, quality="fast"),
        _DEPTH: _drawing(ours, *size, depth=True),
    }
    if peers.THEIRS in environments:
        players[peers.THEIRS] = _drawing(environments[peers.THEIRS], *size)
    return _Contest(players, advance, (_OURS, _BARE, peers.THEIRS))


def _rows_of(task: tuple[str, str], rows: int, **how: str) -> tuple[Any, _Player, _Player]:
    """A batch, what draws its rows, and what steps it with random actions, which it returns."""
    batch = peers.suite(peers.OURS, draws=True).load_batch(*task, num_envs=rows, seed=_SEED)
    batch.reset()
    random, (height, width) = np.random.RandomState(_SEED), _SMALL

    def step() -> np.ndarray:
        actions = random.uniform(-1, 1, batch.action_spec().shape)
        batch.step(actions)
        return actions

    return batch, lambda: batch.render(height=height, width=width, camera_id=0, **how), step


def _batch(task: tuple[str, str], rows: int) -> _Contest:
    """A batch's rows, rendered by `BatchEnvironment` and by a bare `mujoco.Renderer`."""
    batch, ours, step = _rows_of(task, rows)
    simulation = batch.physics.simulation
    model, official = simulation.model._official, simulation._official
    data = mujoco.MjData(model)
    draw = _bare(model, data, *_SMALL)

    def draw_rows() -> np.ndarray:
        pictures = []
        for row in range(rows):
            official.get_data(row, data)
            pictures.append(draw())
        return np.stack(pictures)

    # A bare renderer ignores per-row model fields, so it draws other targets than the arm's.
    alike = (_OURS, _BARE) if task[0] == "humanoid" else ()
    return _Contest({_OURS: ours, _BARE: draw_rows}, step, alike, rows)


def _loop(task: tuple[str, str], rows: int, quality: str) -> _Contest:
    """A batch's rows, rendered by `BatchEnvironment`, and single environments in turn."""
    _, ours, step = _rows_of(task, rows, quality=quality)
    load = peers.suite(peers.OURS, draws=True).load
    singles = [load(*task, {"random": _SEED + row}) for row in range(rows)]
    for single in singles:
        single.reset()
    drawn = [_drawing(single, *_SMALL, quality=quality) for single in singles]

    def advance() -> None:
        for single, action in zip(singles, step(), strict=True):
            single.step(action)

    players = {_OURS: ours, _LOOP: lambda: np.stack([draw() for draw in drawn])}
    return _Contest(players, advance, (_OURS, _LOOP), rows)


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


def _is_drawn_by_software() -> bool:
    return any(name in _renderer() for name in _SOFTWARE)


def _renderer() -> str:
    backend = rendering.backend()
    return backend.renderer if backend is not None else ""


if __name__ == "__main__":
    typer.run(main)
