"""The `repr` of environments, batches and snapshots: task, rows, seed and step.

    repr(env)      # <Environment humanoid:walk, seed 0, step 12 of 1000>
    repr(batch)    # <BatchEnvironment humanoid:walk, 256 rows, seeds 0 to 255, step 12 of 1000>

A part that is not known is left out, such as the seed of an environment that was made with a random
stream. `repr` also works for an object that is closed or only half made.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["Description", "represented"]

_MOST_SEEDS = 4  # that are listed one by one


class Description(NamedTuple):
    """The parts of a `repr`."""

    task: str
    rows: int | None  # None for a single environment
    seeds: Sequence[object]  # one for each row; anything but a whole number is not known
    steps: Sequence[int]  # of each row's episode; empty before the first reset
    step_limit: float = math.inf


def represented(what: object, first: Description, *others: Description) -> str:
    """The `repr` of an object.

    Args:
      what: the object, for the name of its class.
      first: the description of the object, or of its first half.
      others: the description of its second half, if it has one.
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
