"""`learning_of`: the learning curves of the bundled policies' runs, to compare a run with.

    known = learning_of("walker", "walk")
    for run in known.runs:
        print(run.name, run.steps[-1], run.seconds[-1], run.returns[-1])

The numbers are in pretrained/curves.json, which benchmarks/learned.py writes: of each run the mean
returns of the same ten episodes as in its curve.csv, and of each task the best published mean.
`limberjack.see.report` draws them.
"""

import functools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

__all__ = ["FILE", "Learning", "LearningCurve", "known_tasks", "learning_of", "parse"]

FILE = Path(__file__).parent / "pretrained" / "curves.json"


class LearningCurve(NamedTuple):
    """Mean returns of a run's evaluations, over two measures of its length; each is (n,)."""

    name: str
    steps: np.ndarray  # control steps of all rows together
    seconds: np.ndarray  # of one processor core
    returns: np.ndarray


class Learning(NamedTuple):
    """Curves of one task that are compared with each other."""

    title: str
    runs: Sequence[LearningCurve]  # of equal rank
    own: LearningCurve | None = None  # the one that matters
    published: tuple[float, str] | None = None  # a return to compare with, and its name


def known_tasks() -> list[tuple[str, str]]:
    """The domain and the name of each task that has curves, in the order of their names."""
    return list(_known())


def learning_of(domain: str, task: str) -> Learning:
    """The curves of a task, without `own`; a task without a bundled policy has none."""
    return _known().get((domain, task)) or Learning(f"{domain} {task}", ())


def parse(text: str) -> dict[tuple[str, str], Learning]:
    """The curves of each task in a file like the package's, by domain and task."""
    found = {}
    for key, task in json.loads(text).items():
        runs = []
        for run in task["runs"]:
            steps, seconds, returns = np.array(run["curve"], float).T
            runs.append(
                LearningCurve(f"reference run, seed {run['seed']}", steps, seconds, returns)
            )
        best = task["published"]
        level = None if best is None else (best["mean"], f"published, {best['algorithm']}")
        where, _, name = key.partition("-")
        found[where, name] = Learning(f"{where} {name}", runs, None, level)
    return found


@functools.cache
def _known() -> Mapping[tuple[str, str], Learning]:
    return parse(FILE.read_text(encoding="utf-8"))
