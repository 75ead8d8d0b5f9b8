"""Time of the planner's searches for paths of the arm around cup and slot.

    python benchmarks/path_searches.py [--quick] [--json FILE]

The planner plays ten whole episodes of insert_ball and insert_peg, with one thread. README.md
describes the bars. The exit status is 1 if one is missed.
"""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

import numpy as np
import typer
from report import Bar, Json, Quick, Row, at_most, figure, finish

from limberjack import suite
from limberjack.planner import Planner
from limberjack.planner.arm import roadmap
from limberjack.planner.manipulator import approach, insert, release

__all__ = ["main"]

_TASKS = "insert_ball", "insert_peg"
_SEEDS = range(1020, 1025)  # not among those of the scores
_SHARES = {
    "median": (50, None),
    "99th percentile": (99, at_most(100)),
    "worst": (100, at_most(300)),
}


@contextmanager
def _timed() -> Iterator[list[float]]:
    """Context in which the milliseconds of each search are recorded."""
    times: list[float] = []

    def timed(*args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        try:
            return roadmap.find_path(*args, **kwargs)
        finally:
            times.append(1e3 * (time.perf_counter() - start))

    with ExitStack() as patches:
        for module in (approach, insert, release):
            patches.enter_context(mock.patch.object(module, "find_path", timed))
        yield times


def _play(task: str, seed: int, steps: int) -> None:
    """Plays an episode, or its first steps."""
    env = suite.load("manipulator", task, {"random": seed})
    planner = Planner(env, num_threads=1)
    env.reset()
    for _ in range(steps):
        if env.step(planner.act()).last():
            return


def _row(name: str, times: list[float], share: int, bar: Bar | None) -> Row:
    milliseconds = float(np.percentile(times, share))
    return figure(f"path search, {name}", f"{len(times)} searches", milliseconds, "ms", bar)


def main(
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure path searches, and print whether the bars are met."""
    seeds, steps = (_SEEDS[:1], 20) if quick else (_SEEDS, 1000)
    with _timed() as times:
        for task in _TASKS:
            for seed in seeds:
                typer.echo(f"playing: {task}, seed {seed}", err=True)
                _play(task, seed, steps)
    rows = [_row(name, times, share, bar) for name, (share, bar) in _SHARES.items()]
    settings = {"seeds": [seeds.start, seeds.stop], "steps": steps}
    finish(rows, "limit", quick, json, settings)


if __name__ == "__main__":
    typer.run(main)
