"""Observations and rewards of tasks do not rely on features that only NumPy arrays have.

The same code therefore runs unchanged on arrays of other libraries, such as tensors on a GPU.
"""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco.simulation import Fields
from limberjack.rl.reward_terms import reward_and_terms
from limberjack.utils.arrays import rows_of_a_batch
from tests.laws.episodes import TASKS, Task
from tests.laws.strict import StrictArray, values_of

_ROWS, _STEPS = 3, 4


class _Strict:
    """A batch's fields as strict arrays; implements `Fields`."""

    def __init__(self, fields: Fields) -> None:
        self._fields = fields
        self.num_envs: int | None = fields.num_envs
        self.model = fields.model

    def data_field(self, name: str) -> tuple[Any, bool]:
        return StrictArray(self._fields.data_field(name)[0]), True

    def model_field(self, name: str) -> tuple[Any, bool]:
        field, has_rows = self._fields.model_field(name)
        return StrictArray(field) if isinstance(field, np.ndarray) else field, has_rows


@pytest.mark.parametrize("task", TASKS)
def test_a_task_gives_a_strict_array_the_bits_that_it_gives_a_batch(task: Task) -> None:
    batch = suite.load_batch(*task, _ROWS, 1, seed=4)
    batch.reset()
    actions = np.random.RandomState(1).uniform(-1, 1, (_STEPS, *batch.action_spec().shape))
    for action in actions:
        batch.step(action)
    strict = batch.physics.seen_through(_Strict(batch.physics.simulation))
    with rows_of_a_batch(_ROWS):
        expected = batch.task.get_observation(batch.physics)
        found = batch.task.get_observation(strict)
        assert list(found) == list(expected)
        for name, values in expected.items():
            assert isinstance(found[name], StrictArray), name
            np.testing.assert_array_equal(values_of(found[name]), values, name)
        (reward, terms), (expected_reward, expected_terms) = (
            reward_and_terms(batch.task, physics) for physics in (strict, batch.physics)
        )
        for name, values in expected_terms.items():
            np.testing.assert_array_equal(values_of(terms[name]), values, name)
        np.testing.assert_array_equal(values_of(reward), expected_reward)
        if expected_terms and batch.task.GOAL:
            success = values_of(batch.task.is_success(terms))
            np.testing.assert_array_equal(success, batch.task.is_success(expected_terms))
