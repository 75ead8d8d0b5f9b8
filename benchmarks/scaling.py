"""The time of episodes on several processes, against one process with as many threads.

    python benchmarks/scaling.py [--quick] [--only SECTION]... [--repetitions N] [--json FILE]

All scores are compared: both sides must play the same bits. The exit status is 1 if a bar is
missed. Run it on idle cores: a busy one counts against the side that is playing.
"""

import dataclasses
import enum
import importlib.util
import time
from collections.abc import Callable
from typing import Annotated

import typer
from report import Json, Quick, Row, at_most, compared, finish

from limberjack.episodes.player import play_unit
from limberjack.episodes.running import Run
from limberjack.evaluation import evaluate
from limberjack.utils.cores import usable_cores
from limberjack.workers import Scale, Unit, Workers, open_workers, prepare, units_of

__all__ = ["Effort", "Section", "main"]

_TASK = ("manipulator", "bring_ball")
_MANY_CORES = 4  # from which one episode per core must be faster than one on all cores


class Section(enum.StrEnum):
    """A part of the table."""

    PLANNER = "planner"
    RANDOM = "random"
    RAY = "ray"


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    planned: int = 16  # episodes of the planner
    episodes: int = 1_000  # of random actions
    time_limit: float | None = None  # seconds of each
    repetitions: int = 3  # of both sides, in turns


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(planned=2, episodes=70, time_limit=0.05, repetitions=1)

_Scores = dict[int, float]  # returns by seed


def _planned(effort: Effort, workers: int) -> _Scores:
    seeds, scale = range(effort.planned), Scale(workers)
    run = Run(*_TASK, "planner", seeds, time_limit=effort.time_limit, scale=scale)
    run.play()
    return {episode.seed: episode.total for episode in run.episodes}


def _evaluated(effort: Effort, workers: int | None) -> _Scores:
    threads = usable_cores() if workers is None else None
    how = {"time_limit": effort.time_limit, "num_threads": threads, "workers": workers}
    found = evaluate(*_TASK, "random", range(effort.episodes), **how)
    return {score.seed: score.total for score in found.scores["random"]}


def _played(effort: Effort, workers: Workers) -> _Scores:
    setup = prepare(*_TASK, "random", time_limit=effort.time_limit, num_threads=1)
    units = [Unit(setup, seeds) for seeds in units_of(range(effort.episodes))]
    results = workers.results(play_unit, units)
    return {score.seed: score.total for _, scores in results for score in scores}


def _compared(
    measure: str,
    effort: Effort,
    limit: float,
    ours: Callable[[], _Scores],
    theirs: Callable[[], _Scores],
) -> Row:
    """The time of ours over that of theirs; raises RuntimeError if the scores differ."""
    times: tuple[list[float], list[float]] = ([], [])
    scores: dict[int, _Scores] = {}
    for repetition in range(effort.repetitions):
        sides = [(0, ours), (1, theirs)]
        for side, play in sides if repetition % 2 else reversed(sides):
            begun = time.perf_counter()
            scores[side] = play()
            times[side].append(time.perf_counter() - begun)
        if scores[0] != scores[1]:
            raise RuntimeError(f"{measure}: the two sides have different scores")
    details = {"cores": usable_cores(), "episodes": len(scores[0])}
    return compared(measure, ":".join(_TASK), *times, "s", at_most(limit), details)


def _measure(section: Section, effort: Effort) -> list[Row]:
    cores = usable_cores()
    match section:
        case Section.PLANNER:
            measure, limit = f"planner, {cores} workers / 1 worker", 1.0
            if cores >= _MANY_CORES:
                limit = 0.85
            sides = (lambda: _planned(effort, cores)), (lambda: _planned(effort, 1))
        case Section.RANDOM:
            measure, limit = f"random, {cores} workers / one process", 1.15
            sides = (lambda: _evaluated(effort, cores)), (lambda: _evaluated(effort, None))
        case Section.RAY:
            return _measure_ray(effort, cores)
    return [_compared(measure, effort, limit, *sides)]


def _measure_ray(effort: Effort, cores: int) -> list[Row]:
    """Without the start of Ray and of the workers."""
    if importlib.util.find_spec("ray") is None:
        typer.echo("ray is not installed: it is not measured", err=True)
        return []
    first = dataclasses.replace(effort, episodes=64 * cores, time_limit=0.05)
    with open_workers(cores, ray="local") as ray, open_workers(cores) as workers:
        for opened in (ray, workers):
            _played(first, opened)
        sides = (lambda: _played(effort, ray)), (lambda: _played(effort, workers))
        return [_compared(f"random, Ray / {cores} workers", effort, 1.15, *sides)]


def main(
    only: Annotated[
        list[Section] | None, typer.Option(help="Measure this section; may be given repeatedly.")
    ] = None,
    quick: Quick = False,
    repetitions: Annotated[int, typer.Option(min=1, help="Of both sides.")] = Effort.repetitions,
    json: Json = None,
) -> None:
    """Measure episodes on several processes and print each bar and whether it is met."""
    effort = _QUICK if quick else Effort(repetitions=repetitions)
    rows = []
    for section in only or list(Section):
        typer.echo(f"measuring: {section}", err=True)
        rows += _measure(section, effort)
    finish(rows, "compared with", quick, json, dataclasses.asdict(effort))


if __name__ == "__main__":
    typer.run(main)
