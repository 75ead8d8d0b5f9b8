"""The counter on a device reports what the counter of batches on the CPU does."""

from typing import Any

import numpy as np
import pytest

from limberjack.rl import endings

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
counters: Any = pytest.importorskip("limberjack.gpu.counters")

_ROWS, _LIMIT, _STEPS = 64, 7, 60


def test_it_counts_as_the_counter_on_the_cpu() -> None:
    random = np.random.RandomState(0)
    ours = counters.Counter(_ROWS, _LIMIT, "cpu")
    theirs = endings.Counter(_ROWS, _LIMIT)
    begins = np.zeros(_ROWS, bool)
    for _ in range(_STEPS):
        reward = random.uniform(size=_ROWS).astype(np.float32)
        diverged = (random.uniform(size=_ROWS) < 0.05) & ~begins
        termination = np.where(random.uniform(size=_ROWS) < 0.1, 0.0, np.nan)
        begun = ours.ended.clone()
        shown, ending = ours.count(
            begun, *map(torch.from_numpy, (diverged, reward.copy(), termination))
        )
        expected, last = theirs.count(begins, diverged, reward, termination, {})
        np.testing.assert_array_equal(as_numpy(begun), begins)
        np.testing.assert_array_equal(as_numpy(shown), expected.reward)
        np.testing.assert_array_equal(as_numpy(ending.last), expected.step_type == 2)
        truncated = last & theirs.at_limit & ~diverged
        np.testing.assert_array_equal(as_numpy(ending.truncated), truncated)
        np.testing.assert_array_equal(as_numpy(ending.terminated), last & ~truncated)
        np.testing.assert_array_equal(as_numpy(ours.steps), theirs.steps)
        begins = last


def test_a_row_that_waits_keeps_how_it_ended_and_earns_nothing() -> None:
    counter = counters.Counter(2, 3, "cpu")
    none, ones = torch.zeros(2, dtype=torch.bool), torch.ones(2)
    for _ in range(4):
        counter.count(none, torch.tensor([False, True]), ones, None)
    reward, ending = counter.count(none, torch.tensor([False, True]), ones, None)
    np.testing.assert_array_equal(as_numpy(ending.truncated), [True, False])
    np.testing.assert_array_equal(as_numpy(ending.terminated), [False, True])
    np.testing.assert_array_equal(as_numpy(reward), [0, 0])
    np.testing.assert_array_equal(as_numpy(counter.steps), [3, 1])
    counter.begin(torch.tensor([True, False]))
    reward, ending = counter.count(none, none, ones, None)
    np.testing.assert_array_equal(as_numpy(ending.last), [False, True])
    np.testing.assert_array_equal(as_numpy(reward), [1, 0])
