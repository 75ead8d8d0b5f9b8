"""The speed of collecting datasets, and of reading them, in one table.

    python benchmarks/collecting.py [--quick] [--json FILE]

README.md describes the comparisons. The exit status is 1 if a bar is missed.
"""

import collections
import contextlib
import dataclasses
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import typer
from report import Json, Quick, Row, at_least, compared, finish, spread

from limberjack import data
from limberjack.episodes.player import Player

__all__ = ["Effort", "main"]

_TASKS = (("humanoid", "walk"), ("manipulator", "bring_ball"))
_COLLECTING, _READING = at_least(0.8), at_least(5.0)


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    turns: int = 5  # of each task, by each side
    episodes: int = 192  # of a turn, in batches of 64
    seconds: float | None = None  # of an episode; None for the task's own


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(turns=1, episodes=3, seconds=0.2)


def _measure(domain: str, task: str, effort: Effort) -> Iterator[Row]:
    """The rows of a task: the sides take turns, and neighbouring turns are compared."""
    rates: dict[str, list[float]] = collections.defaultdict(list)  # steps per second
    for turn in range(effort.turns):
        seeds = range(turn * effort.episodes, (turn + 1) * effort.episodes)
        with tempfile.TemporaryDirectory() as folder:
            rates["evaluate"].append(_evaluated(domain, task, seeds, effort))
            rates["collect"].append(_collected(domain, task, seeds, effort, Path(folder)))
            rates["read"].append(_read(Path(folder)))
    theirs = rates.pop("evaluate")
    for (name, ours), bar in zip(rates.items(), (_COLLECTING, _READING), strict=True):
        details = {"steps_per_second": spread(ours)}
        subject = f"{domain}:{task}"
        yield compared(f"{name} / evaluate", subject, ours, theirs, "steps/s", bar, details)


def _evaluated(domain: str, task: str, seeds: range, effort: Effort) -> float:
    """Steps per second of random episodes as `evaluate` plays them, with the kinds of starts."""
    began = time.perf_counter()
    steps = 0
    player = Player(domain, task, "random", seeds, time_limit=effort.seconds)
    with contextlib.closing(player):
        for _, episodes in player.results(player.units(seeds), list):
            steps += sum(one.length for one in episodes)
    return steps / (time.perf_counter() - began)


def _collected(domain: str, task: str, seeds: range, effort: Effort, folder: Path) -> float:
    """Steps per second of the same episodes, collected with everything but states."""
    began = time.perf_counter()
    data.collect(domain, task, "random", seeds, out=folder, time_limit=effort.seconds)
    return data.load(folder).steps / (time.perf_counter() - began)


def _read(folder: Path) -> float:
    """Steps per second of all arrays of the episodes, read in one thread."""
    began = time.perf_counter()
    dataset = data.load(folder)
    steps = sum(episode.length for episode in dataset)
    return steps / (time.perf_counter() - began)


def main(
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure collecting and reading against evaluating, and print whether the bars are met."""
    effort = _QUICK if quick else Effort()
    rows = []
    for domain, task in _TASKS:
        typer.echo(f"measuring: {domain} {task}", err=True)
        rows += _measure(domain, task, effort)
    finish(rows, "evaluate", quick, json, dataclasses.asdict(effort))


if __name__ == "__main__":
    typer.run(main)
