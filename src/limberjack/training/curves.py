"""`learning_of`: learning curves of the bundled policies' runs, to compare a run with.

    known = learning_of("walker", "walk")
    for run in known.runs:
        print(run.name, run.steps[-1], run.seconds[-1], run.returns[-1])

The numbers are in curves.json beside this file, which benchmarks/learned.py writes: of each run the
mean returns of the same ten episodes as in curve.csv, and of each task the best published mean.
"""

import functools
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from limberjack.see.report import Learning, LearningCurve

__all__ = ["FILE", "known_tasks", "learning_of", "parse"]

FILE = Path(__file__).with_name("curves.json")


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
