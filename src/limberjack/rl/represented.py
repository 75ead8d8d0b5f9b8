"""The `repr` of environments, batches and snapshots: task, rows, seed and step.

    repr(env)      # <Environment humanoid:walk, seed 0, step 12 of 1000>
    repr(batch)    # <BatchEnvironment humanoid:walk, 256 rows, seeds 0 to 255, step 12 of 1000>

A part that is not known is left out, such as the seed of an environment that was made with a random
stream. `repr` also works for an object that is closed or only half made.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from limberjack.rl.contract import Task
from limberjack.rl.endings import Counter
from limberjack.rl.streams import Streams

__all__ = ["Description", "of_batch", "of_environment", "represented"]

_MOST_SEEDS = 4  # that are listed one by one


class Description(NamedTuple):
    """The parts of a `repr`."""

    task: str
    rows: int | None  # None for a single environment
    seeds: Sequence[object]  # one for each row; anything but a whole number is not known
    steps: Sequence[int]  # of each row's episode; empty before the first reset
    step_limit: float = math.inf


class _Environment(Protocol):
    """The class attributes of a `control.Environment`; others may be missing."""

    _name: str
    _seeded: tuple[object, object]


class _Batch(Protocol):
    """The attributes of a `BatchEnvironment`."""

    num_envs: int
    _name: str
    _task: Task
    _streams: Streams
    _counter: Counter
    _begins: np.ndarray


def of_environment(env: _Environment) -> Description:
    """The description of a single environment, also of one that is only half made."""
    task = getattr(env, "_task", None)
    stream, seed = env._seeded
    is_first = stream is not None and stream is getattr(task, "random", None)
    step, waits = getattr(env, "_step_count", 0), getattr(env, "_reset_next_step", True)
    return Description(
        env._name or type(task).__name__,
        None,
        [seed if is_first else None],
        [] if waits and not step else [step],
        getattr(env, "_step_limit", math.inf),
    )


def of_batch(batch: _Batch) -> Description:
    """The description of a batch."""
    steps = batch._counter.steps.tolist()
    return Description(
        batch._name or type(batch._task).__name__,
        batch.num_envs,
        batch._streams.seeds,
        [] if batch._begins.all() and not any(steps) else steps,
        batch._counter.step_limit,
    )


def represented(what: object, first: Description, *others: Description) -> str:
    """The `repr` of an object.

    Args:
      what: the object, for the name of its class.
      first: its description, or that of its first half.
      others: that of its second half, if it has one.
    """
    parts = (first, *others)
    texts = [first.task]
    if first.rows is not None:
        rows = sum(part.rows or 0 for part in parts)
        texts.append(f"{rows} rows" if rows != 1 else "1 row")
    seeds = _seeds([seed for part in parts for seed in part.seeds])
    steps = [step for part in parts for step in part.steps]
    texts += [seeds] if seeds else []
    texts.append(_steps(steps, first.step_limit))
    return f"<{type(what).__name__} {', '.join(texts)}>"


def _seeds(seeds: Sequence[object]) -> str:
    """The seeds in words; the empty string if one is not known, or they are too many to list."""
    known = [int(seed) for seed in seeds if isinstance(seed, int | np.integer)]
    if not known or len(known) != len(seeds):
        return ""
    if len(known) == 1:
        return f"seed {known[0]}"
    if known == list(range(known[0], known[0] + len(known))):
        return f"seeds {known[0]} to {known[-1]}"
    return f"seeds {', '.join(map(str, known))}" if len(known) <= _MOST_SEEDS else ""


def _steps(steps: Sequence[int], limit: float) -> str:
    if not steps:
        return "not reset yet"
    least, most = min(steps), max(steps)
    text = f"step {least}" if least == most else f"steps {least} to {most}"
    return f"{text} of {math.ceil(limit)}" if math.isfinite(limit) else text
