"""Starts are used in turn, and replaced in turn."""

from typing import Any

import numpy as np
import pytest

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
ring: Any = pytest.importorskip("limberjack.gpu.ring")


def _ring() -> Any:
    return ring.Ring(torch.arange(5.0)[:, None])


def test_rows_of_a_mask_take_the_next_starts_in_order() -> None:
    starts = _ring()
    for mask, expected in (
        ([0, 1, 0, 1], [0, 1]),
        ([1, 1, 1, 0], [2, 3, 4]),
        ([0, 0, 1, 1], [0, 1]),
    ):
        chosen = torch.tensor(mask, dtype=torch.bool)
        np.testing.assert_array_equal(as_numpy(starts.take(chosen)[chosen][:, 0]), expected)


def test_an_empty_mask_takes_none() -> None:
    starts = _ring()
    starts.take(torch.zeros(4, dtype=torch.bool))
    assert starts.head == 0


@pytest.mark.parametrize("counts", [(1,) * 13, (3, 4, 5), (5, 5), (7, 6), (13,)])
def test_the_oldest_starts_are_replaced_first(counts: tuple[int, ...]) -> None:
    starts, expected, tail, number = _ring(), np.arange(5.0), 0, 10.0
    for count in counts:
        new = np.arange(number, number + count, dtype=np.float32)
        starts.replace(new[:, None])
        for value in new:
            expected[tail] = value
            tail, number = (tail + 1) % 5, number + 1
    np.testing.assert_array_equal(as_numpy(starts.values[:, 0]), expected)
    assert starts.tail == tail
