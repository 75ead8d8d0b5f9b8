"""Batches of complete environments: each row equals the single environment, whatever its class."""

from typing import Any

import numpy as np
import pytest

from limberjack.rl.rows import RowsEnvironment

from . import odd_environments as odd

_SEED = 3


def _singles(kind: str, actions: np.ndarray) -> list[list[odd.Facts]]:
    """What single environments do: a list a step, of rows."""
    rows = range(actions.shape[1])
    played = [odd.steps_of(odd.KINDS[kind](_SEED + row), actions[:, row]) for row in rows]
    return [list(step) for step in zip(*played, strict=True)]


@pytest.mark.parametrize("kind", odd.KINDS)
@pytest.mark.parametrize(("rows", "threads"), [(1, 1), (2, 1), (5, 2)])
def test_each_row_is_the_single_environment(kind: str, rows: int, threads: int) -> None:
    actions = odd.actions_of(2 * odd.STEPS + 5, rows)
    expected = _singles(kind, actions)
    batch = RowsEnvironment(odd.KINDS[kind], rows, threads, seed=_SEED)
    assert odd.future(batch, actions) == expected
    batch.close()
