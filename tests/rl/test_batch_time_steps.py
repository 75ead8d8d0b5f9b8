"""Time steps of a batch: rewards, discounts and step types of each row."""

import collections
from typing import Any

import dm_env
import numpy as np
import pytest

from limberjack import mujoco
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import shift, stream_beside
from limberjack.suite import base

from .odd_environments import SLIDER

_FIRST, _MID, _LAST = (int(kind) for kind in dm_env.StepType)
_ROWS, _LIMIT = 3, 6  # rows, and steps in an episode
_NOT_ENDED = np.nan


class _Scripted(base.Task):
    """A task whose rewards and terminations are set by the test once the batch is created."""

    rewards: Any = None
    discounts: Any = None

    def initialize_episode(self, physics: Any) -> None:
        physics.named.data.qpos["slide"] = self.random.uniform(-1, 1)

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict(position=physics.position())

    def get_reward(self, physics: Any) -> Any:
        return physics.position()[..., 0] if self.rewards is None else self.rewards

    def get_termination(self, physics: Any) -> Any:
        return self.discounts


def _single(seed: int = 0, **kwargs: Any) -> control.Environment:
    physics = mujoco.Physics.from_xml_string(SLIDER)
    limit = _LIMIT * physics.timestep()
    return control.Environment(physics, _Scripted(seed), time_limit=limit, **kwargs)


def _made() -> tuple[BatchEnvironment, _Scripted]:
    batch = BatchEnvironment.from_environment(_single(), _ROWS, 1, seed=0)
    batch.task.rewards = np.array([2.0, 3.0, 4.0])
    return batch, batch.task


@pytest.fixture
def made() -> tuple[BatchEnvironment, _Scripted]:
    """A batch whose episodes have just begun, and its task."""
    batch, task = _made()
    batch.reset()
    return batch, task


def _step(batch: BatchEnvironment) -> dm_env.TimeStep:
    return batch.step(np.zeros((_ROWS, 1)))


def test_a_row_that_begins_has_no_reward_and_is_not_discounted(made: Any) -> None:
    batch, task = made
    task.discounts = np.array([_NOT_ENDED, 0.5, _NOT_ENDED])
    ended = _step(batch)
    assert ended.step_type.tolist() == [_MID, _LAST, _MID]
    assert ended.reward.tolist() == [2.0, 3.0, 4.0]
    task.discounts = None
    begun = _step(batch)
    assert begun.step_type.tolist() == [_MID, _FIRST, _MID]
    assert begun.reward.tolist() == [2.0, 0.0, 4.0]
    assert begun.discount.tolist() == [1.0, 1.0, 1.0]


def test_the_first_step_of_a_new_batch_is_the_start_of_every_row() -> None:
    batch, _ = _made()
    begun = _step(batch)
    assert begun.step_type.tolist() == [_FIRST] * _ROWS
    assert begun.reward.tolist() == [0.0] * _ROWS


def test_each_row_counts_its_own_steps_to_the_time_limit(made: Any) -> None:
    batch, task = made
    task.discounts = np.array([_NOT_ENDED, 0.0, _NOT_ENDED])
    _step(batch)  # ends the episode of row 1, which begins the next one a step later
    task.discounts = None
    kinds = np.array([_step(batch).step_type for _ in range(_LIMIT + 1)])
    assert np.flatnonzero(kinds[:, 0] == _LAST).tolist() == [_LIMIT - 2]
    assert np.flatnonzero(kinds[:, 1] == _FIRST).tolist() == [0]
    assert np.flatnonzero(kinds[:, 1] == _LAST).tolist() == [_LIMIT]


def test_each_row_ends_with_its_own_discount(made: Any) -> None:
    batch, task = made
    task.discounts = np.array([_NOT_ENDED, 0.25, 0.75])
    ended = _step(batch)
    assert ended.discount.tolist() == [1.0, 0.25, 0.75]
    assert ended.step_type.tolist() == [_MID, _LAST, _LAST]
    assert not batch.timed_out.any()


def test_at_the_time_limit_the_discount_is_1_regardless_of_the_task(made: Any) -> None:
    batch, task = made
    for _ in range(_LIMIT - 1):
        assert not batch.timed_out.any()
        _step(batch)
    task.discounts = np.zeros(_ROWS)
    ended = _step(batch)
    assert ended.step_type.tolist() == [_LAST] * _ROWS
    assert ended.discount.tolist() == [1.0] * _ROWS  # as `control.Environment`
    assert batch.timed_out.all()


def test_a_start_does_not_end_its_episode(made: Any) -> None:
    batch, task = made
    task.discounts = np.zeros(_ROWS)
    _step(batch)
    begun = _step(batch)
    assert begun.step_type.tolist() == [_FIRST] * _ROWS
    assert begun.discount.tolist() == [1.0] * _ROWS
    assert not batch.begins.any()


def test_rewards_that_a_task_keeps_are_not_written_to(made: Any) -> None:
    batch, task = made
    task.discounts = np.zeros(_ROWS)
    ended = _step(batch)
    assert _step(batch).reward.tolist() == [0.0] * _ROWS
    assert task.rewards.tolist() == [2.0, 3.0, 4.0]
    task.rewards[:] = 7.0
    assert ended.reward.tolist() == [2.0, 3.0, 4.0]


def test_one_reward_for_all_is_each_rows(made: Any) -> None:
    batch, task = made
    task.rewards = 5.0
    task.discounts = np.array([0.0, _NOT_ENDED, _NOT_ENDED])
    assert _step(batch).reward.tolist() == [5.0, 5.0, 5.0]
    assert _step(batch).reward.tolist() == [0.0, 5.0, 5.0]


def test_the_mask_of_rows_that_begin_next_is_a_copy(made: Any) -> None:
    batch, _ = made
    batch.begins[:] = True
    assert not batch.begins.any()
    assert _step(batch).step_type.tolist() == [_MID] * _ROWS


def test_a_reset_of_some_rows_shows_the_others_in_mid_episode(made: Any) -> None:
    batch, _ = made
    _step(batch)
    shown = batch.reset([1])
    assert shown.step_type.tolist() == [_MID, _FIRST, _MID]
    assert shown.reward.tolist() == [0.0] * _ROWS


def test_model_fields_are_drawn_from_a_separate_stream_per_row() -> None:
    single = _single(randomize={"body_mass": shift(0, 1)})
    nominal = single.physics.model.body_mass.copy()
    batch = BatchEnvironment.from_environment(single, 2, 1, seed=8)
    first = batch.reset()
    for row in range(2):
        drawn = stream_beside(np.random.RandomState(8 + row)).uniform(0, 1, nominal.shape)
        np.testing.assert_array_equal(batch.randomization["body_mass"][row], nominal + drawn)
        start = np.random.RandomState(8 + row).uniform(-1, 1)
        assert first.observation["position"][row, 0] == start


class _Counting(_Scripted):
    """Counts its steps in the data."""

    def after_step(self, physics: Any) -> None:
        physics.data.qfrc_applied[..., 0] += 1e-3

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict(count=physics.data.qfrc_applied.copy())


def test_after_step_does_not_reach_the_start_of_the_next_episode() -> None:
    def made(seed: int) -> control.Environment:
        physics = mujoco.Physics.from_xml_string(SLIDER)
        return control.Environment(physics, _Counting(seed), time_limit=3 * physics.timestep())

    single, batch = made(0), BatchEnvironment.from_environment(made(0), 2, 1, seed=0)
    expected, found = single.reset(), batch.reset()
    for _ in range(9):
        np.testing.assert_array_equal(found.observation["count"][0], expected.observation["count"])
        expected, found = single.step(np.zeros(1)), batch.step(np.zeros((2, 1)))
