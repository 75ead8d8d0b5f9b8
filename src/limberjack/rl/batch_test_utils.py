"""A test class that checks the contract of batches for your own task, like `dm_env.test_utils`.

    class SwingUpBatchTest(batch_test_utils.BatchEnvironmentTestMixin, unittest.TestCase):
        def make_single(self, seed):
            return swing_up(time_limit=0.2, random=seed)

The tests run a few short episodes: give the environment a time limit of a few steps, so that
episodes end and begin during a test.
"""

from collections.abc import Iterator

import dm_env
import numpy as np

from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.control import Environment

__all__ = ["BatchEnvironmentTestMixin"]

_FIRST, _LAST = int(dm_env.StepType.FIRST), int(dm_env.StepType.LAST)


class BatchEnvironmentTestMixin:
    """Tests for a `unittest.TestCase` that defines `make_single`."""

    num_envs = 3
    num_threads = 2
    num_steps = 40
    seed = 7

    def make_single(self, seed: int) -> Environment:
        """The single environment that row `seed - self.seed` of a batch must equal."""
        raise NotImplementedError(f"{type(self).__name__} does not define make_single(seed)")

    def make_object_under_test(self, num_envs: int, num_threads: int) -> BatchEnvironment:
        """A batch whose row i has the seed `self.seed + i`."""
        single = self.make_single(self.seed)
        return BatchEnvironment.from_environment(single, num_envs, num_threads, self.seed)

    def make_action_sequence(self, batch: BatchEnvironment) -> Iterator[np.ndarray]:
        """Actions for `num_steps` steps, by default random within the bounds."""
        random = np.random.RandomState(self.seed)
        spec = batch.action_spec()
        low, high = bounds_to_try(spec)
        for _ in range(self.num_steps):
            yield random.uniform(low, high, spec.shape).astype(spec.dtype)

    def test_a_row_is_the_single_environment(self) -> None:
        batch = self.make_object_under_test(self.num_envs, self.num_threads)
        singles = [self.make_single(self.seed + i) for i in range(self.num_envs)]
        batched, expected = batch.reset(), [single.reset() for single in singles]
        for actions in self.make_action_sequence(batch):
            for row, time_step in enumerate(expected):
                _assert_row(batched, row, time_step)
            batched = batch.step(actions)
            expected = [single.step(a) for single, a in zip(singles, actions, strict=True)]

    def test_threads_and_other_rows_change_nothing(self) -> None:
        batch = self.make_object_under_test(self.num_envs, 1)
        larger = self.make_object_under_test(2 * self.num_envs, self.num_threads)
        rows = np.arange(self.num_envs)
        _assert_rows(larger.reset(), batch.reset(), rows)
        for actions in self.make_action_sequence(batch):
            _assert_rows(larger.step(np.concatenate([actions, actions])), batch.step(actions), rows)

    def test_a_reset_of_one_row_leaves_the_others(self) -> None:
        batch, reference = (
            self.make_object_under_test(self.num_envs, self.num_threads) for _ in range(2)
        )
        batch.reset()
        reference.reset()
        others = np.arange(self.num_envs - 1)
        for number, actions in enumerate(self.make_action_sequence(batch)):
            if number == 1:
                batch.reset([self.num_envs - 1])
            _assert_rows(batch.step(actions), reference.step(actions), others)

    def test_each_ended_episode_is_followed_by_a_new_one(self) -> None:
        batch = self.make_object_under_test(self.num_envs, self.num_threads)
        before = batch.reset().step_type
        for actions in self.make_action_sequence(batch):
            now = batch.step(actions).step_type
            assert ((now == _FIRST) == (before == _LAST)).all(), "FIRST must follow LAST only"
            before = now

    def test_a_restored_snapshot_has_the_same_future(self) -> None:
        batch = self.make_object_under_test(self.num_envs, self.num_threads)
        actions = list(self.make_action_sequence(batch))
        batch.reset()
        for action in actions[: self.num_steps // 4]:
            batch.step(action)
        snapshot = batch.snapshot()
        future = [batch.step(action) for action in actions]
        batch.restore(snapshot)
        rows = np.arange(self.num_envs)
        for action, expected in zip(actions, future, strict=True):
            _assert_rows(batch.step(action), expected, rows)

    def test_actions_that_are_not_finite_are_rejected_and_change_nothing(self) -> None:
        batch, reference = (
            self.make_object_under_test(self.num_envs, self.num_threads) for _ in range(2)
        )
        batch.reset()
        reference.reset()
        actions = next(self.make_action_sequence(batch))
        try:
            batch.step(np.full_like(actions, np.nan, dtype=float))
        except ValueError:
            pass
        else:
            raise AssertionError("NaN was accepted as an action")
        _assert_rows(batch.step(actions), reference.step(actions), np.arange(self.num_envs))

    def test_time_steps_conform_to_the_specs(self) -> None:
        batch = self.make_object_under_test(self.num_envs, self.num_threads)
        observation_spec = batch.observation_spec()
        batch.reset()
        for actions in self.make_action_sequence(batch):
            time_step = batch.step(actions)
            batch.reward_spec().validate(time_step.reward)
            batch.discount_spec().validate(time_step.discount)
            assert list(time_step.observation) == list(observation_spec)
            for name, spec in observation_spec.items():
                spec.validate(time_step.observation[name])


def _assert_row(batched: dm_env.TimeStep, row: int, single: dm_env.TimeStep) -> None:
    where = f"row {row}"
    assert batched.step_type[row] == int(single.step_type), where
    if not single.first():
        np.testing.assert_array_equal(batched.reward[row], single.reward, where)
        np.testing.assert_array_equal(batched.discount[row], single.discount, where)
    assert list(batched.observation) == list(single.observation), where
    for name, value in single.observation.items():
        np.testing.assert_array_equal(batched.observation[name][row], value, f"{where} {name}")


def _assert_rows(ours: dm_env.TimeStep, theirs: dm_env.TimeStep, rows: np.ndarray) -> None:
    np.testing.assert_array_equal(ours.step_type[rows], theirs.step_type[rows])
    np.testing.assert_array_equal(ours.reward[rows], theirs.reward[rows])
    np.testing.assert_array_equal(ours.discount[rows], theirs.discount[rows])
    for name, value in theirs.observation.items():
        np.testing.assert_array_equal(ours.observation[name][rows], value[rows], name)
