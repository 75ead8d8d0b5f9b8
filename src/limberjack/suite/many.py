"""Batches of several tasks, made by a function that makes the batch of one; see `rl.many`.

    (many,) = load(suite.load_batch, 1, ["cheetah:run", "walker:walk"], rows=8)
    first, second = load(suite.load_batch, 2, "dmc28", rows=8)      # halves

`suite.load_batch` and `suite.load_halves` call it.
"""

import dataclasses
import inspect
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from limberjack.registry import sets
from limberjack.registry.sets import Tasks
from limberjack.rl.batch_contract import Batch
from limberjack.rl.guards import at_least_one, first_seed
from limberjack.rl.many import ManyTasks, TaskOfMany, threads_of_one
from limberjack.suite._registration import find

__all__ = ["instruction", "load"]


def load(
    load_one: Callable[..., Batch],
    parts: int,
    tasks: Tasks,
    rows: int | Sequence[int] | None = None,
    num_envs: int | None = None,
    num_threads: int | None = None,
    seed: int | None = None,
    **kwargs: Any,  # of `suite.load_batch`, which checks them
) -> list[ManyTasks]:
    """The batch of several tasks, whose rows are divided into parts with arrays of one width.

    Args:
      load_one: `suite.load_batch`.
      parts: 1, or 2 for halves, of which the first has the row more.
      tasks: the name of a set, or a list; see `registry.sets.find`.
      rows: of each task; a number for all, or a list with one for each.
      num_envs: rows of all tasks together, in the place of `rows`.
      num_threads: of all tasks together; by default as many as there are cores, at most 8.
      seed: row i of the whole equals `suite.load` with `{'random': seed + i}`; None for any.
      kwargs: of `suite.load_batch`, for each task.

    Raises:
      ValueError, TypeError: see `registry.sets.find` and `suite.load_batch`; or rows are not given
        once, do not fit the tasks, or are fewer than the parts.
    """
    chosen = sets.tasks_of(tasks)
    counts = _counts(rows, num_envs, len(chosen))
    total = sum(counts)
    if total < parts:
        raise ValueError(f"there is {total} row; expected at least {parts} for two halves")
    bounds = [total - total * left // parts for left in range(parts, -1, -1)]
    first, threads = first_seed(seed, total), threads_of_one(num_threads, len(chosen))
    batches: list[list[Batch]] = [[] for _ in range(parts)]
    facts, start = [], 0
    for (domain, task), count in zip(chosen, counts, strict=True):
        stop = start + count
        for of_part, (low, high) in zip(batches, itertools.pairwise(bounds), strict=True):
            size = min(stop, high) - max(start, low)
            if size > 0:
                own = first + max(start, low)
                of_part.append(load_one(domain, task, size, threads, own, **kwargs))
        made = next(of_part[-1] for of_part in batches[::-1] if of_part)
        fact = TaskOfMany.of(made, start, instruction(domain, task))
        facts.append(dataclasses.replace(fact, rows=slice(start, stop)))
        start = stop
    return [ManyTasks(of_part, facts, num_threads) for of_part in batches]


def instruction(domain: str, task: str) -> str:
    """The goal of a task in a sentence, the first of its function's text."""
    found = find(domain)
    text = None if found is None else inspect.getdoc(found.load().SUITE[task])
    return (text or "").partition("\n")[0]


def _counts(rows: int | Sequence[int] | None, num_envs: int | None, num_tasks: int) -> list[int]:
    """The number of rows of each task."""
    if (rows is None) is (num_envs is None):
        raise TypeError(
            f"rows is {rows!r} and num_envs is {num_envs!r}; expected one of them for a list of "
            "tasks: rows of each task, or of all together"
        )
    if num_envs is not None:
        if at_least_one("num_envs", num_envs) % num_tasks:
            raise ValueError(
                f"num_envs is {num_envs}; expected a multiple of {num_tasks}, the number of tasks"
            )
        return [num_envs // num_tasks] * num_tasks
    if not isinstance(rows, Sequence | np.ndarray):
        return [at_least_one("rows", rows)] * num_tasks
    counts = [at_least_one("rows", count) for count in rows]
    if len(counts) != num_tasks:
        raise ValueError(
            f"rows has {len(counts)} numbers; expected {num_tasks}, one for each task, or one "
            "number for all"
        )
    return counts
