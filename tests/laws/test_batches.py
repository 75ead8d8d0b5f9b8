"""Row i of any batch is the single environment with seed + i, bit for bit, for every task."""

import unittest
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import batch_test_utils, control
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import humanoid

from .episodes import TASKS, Task, costly, rotated, short, variant

_SEED = 11
_SHARE = ("own", "shared")  # see the fixture `share`
_STEPS_OF_AN_EPISODE = 16


def _short(task: Task) -> dict[str, Any]:
    """A time limit short enough for several episodes per row."""
    return dict(short(task, _STEPS_OF_AN_EPISODE))


def _assert_row(row: int, batched: Any, single: Any, where: str) -> None:
    assert batched.step_type[row] == int(single.step_type), where
    if not single.first():
        assert batched.reward[row] == single.reward, where
        assert batched.discount[row] == single.discount, where
    assert list(batched.observation) == list(single.observation)
    for name, value in single.observation.items():
        np.testing.assert_array_equal(batched.observation[name][row], value, f"{where} {name}")
        assert batched.observation[name].dtype == value.dtype


def _actions(batch: BatchEnvironment, steps: int) -> np.ndarray:
    """Random actions within the bounds, (steps, num_envs, ...)."""
    spec = batch.action_spec()
    low, high = np.maximum(spec.minimum, -1.0), np.minimum(spec.maximum, 1.0)
    return np.random.RandomState(0).uniform(low, high, (steps, *spec.shape))


def _play(task: Task, batch: BatchEnvironment, singles: list[Any], steps: int) -> None:
    """Plays at least three episodes, with one row reset separately, and compares every row."""
    actions = _actions(batch, steps)
    batched, told = batch.reset(), [env.reset() for env in singles]
    for step, action in enumerate(actions):
        for row, single in enumerate(told):
            _assert_row(row, batched, single, f"{task} row {row} step {step}")
        if step == 10:  # from here on the rows' episodes end at different times
            batched = batch.reset([0])
            told[0] = singles[0].reset()
            for name, value in told[0].observation.items():
                np.testing.assert_array_equal(batched.observation[name][0], value)
        batched = batch.step(action)
        told = [env.step(a) for env, a in zip(singles, action, strict=True)]


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize(
    ("task", "share", "num_envs", "num_threads"),
    costly(rotated(_SHARE, (2, 7, 1), (2, 4, 1))),
    indirect=["share"],
)
def test_a_row_is_the_single_environment(task: Task, num_envs: int, num_threads: int) -> None:
    kwargs = _short(task)
    batch = suite.load_batch(*task, num_envs, num_threads, _SEED, task_kwargs=kwargs)
    singles = [suite.load(*task, {"random": _SEED + i, **kwargs}) for i in range(num_envs)]
    _play(task, batch, singles, 3 * _STEPS_OF_AN_EPISODE + 10)


@pytest.mark.parametrize("task", costly(TASKS))
def test_the_laws_that_users_test_their_own_tasks_with_hold(task: Task) -> None:
    class Laws(batch_test_utils.BatchEnvironmentTestMixin, unittest.TestCase):
        def make_single(self, seed: int) -> Any:
            return suite.load(*task, {"random": seed, **_short(task)})

    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromTestCase(Laws).run(result)
    assert result.testsRun == 7
    assert result.wasSuccessful(), [*result.errors, *result.failures]


def test_a_task_that_breaks_a_law_fails_it() -> None:
    calls: list[None] = []

    def count() -> int:
        calls.append(None)
        return len(calls)

    class Forgetful(humanoid.Humanoid):
        def get_reward(self, physics: Any) -> Any:
            # After the few steps that are compared when a batch is created.
            is_late = np.asarray(physics.time()) > 0.24
            return super().get_reward(physics) + np.where(is_late, count(), 0)

    class Laws(batch_test_utils.BatchEnvironmentTestMixin, unittest.TestCase):
        num_steps = 14

        def make_single(self, seed: int) -> Any:
            env = suite.load("humanoid", "stand", {"random": seed})
            task = Forgetful(move_speed=0, pure_state=False, random=seed)
            return control.Environment(env.physics, task, time_limit=1, control_timestep=0.025)

    result = unittest.TestResult()
    unittest.defaultTestLoader.loadTestsFromTestCase(Laws).run(result)
    broken = {test.id().rpartition(".")[2] for test, _ in result.failures}
    assert "test_a_row_is_the_single_environment" in broken
    assert "test_each_ended_episode_is_followed_by_a_new_one" not in broken


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize(
    ("task", "share", "num_threads"), costly(rotated(_SHARE, (2, 4))), indirect=["share"]
)
def test_64_rows_on_any_number_of_threads_are_the_same(task: Task, num_threads: int) -> None:
    kwargs = _short(task)
    num_envs = 12 if task == ("quadruped", "escape") else 64  # terrain is drawn slowly
    batches = [
        suite.load_batch(*task, num_envs, threads, _SEED, task_kwargs=kwargs)
        for threads in (1, num_threads)
    ]
    for batch in batches:
        batch.reset()
    for action in _actions(batches[0], _STEPS_OF_AN_EPISODE + 10):
        first, other = [batch.step(action) for batch in batches]
        np.testing.assert_array_equal(first.reward, other.reward)
        for name, value in first.observation.items():
            np.testing.assert_array_equal(value, other.observation[name])


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize(
    ("task", "share", "whole_steps"), costly(rotated(_SHARE, (False, True))), indirect=["share"]
)
def test_a_field_bound_late_equals_that_of_the_single_environments(
    task: Task, whole_steps: bool
) -> None:
    # MuJoCo writes a field only in calls after it was bound.
    kwargs = _short(task)
    options = {"legacy_step": not whole_steps}
    batch = suite.load_batch(*task, 3, 2, _SEED, task_kwargs=kwargs, environment_kwargs=options)
    singles = [suite.load(*task, {"random": _SEED + i, **kwargs}, options) for i in range(3)]
    batch.reset()
    for single in singles:
        single.reset()
    actions = iter(_actions(batch, 100))
    fields = ["xquat", "qacc", "cvel", "sensordata", "qfrc_constraint", "actuator_force"]
    fields += ["qfrc_bias", "geom_xpos", "cinert", "qacc_smooth", "subtree_com", "cfrc_ext"]
    for number, name in enumerate(fields):
        for _ in range(4):  # some rows begin their second episode on the way
            action = next(actions)
            batch.step(action)
            for single, a in zip(singles, action, strict=True):
                single.step(a)
        if number == 2:
            batch.reset([1])
            singles[1].reset()
        state = batch.physics.data.state.copy()
        values = getattr(batch.physics.data, name)
        np.testing.assert_array_equal(batch.physics.data.state, state)
        for row, single in enumerate(singles):
            expected = getattr(single.physics.data, name)
            np.testing.assert_array_equal(values[row], expected, f"{name}, row {row}")


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_64_rows_are_64_single_environments(task: Task) -> None:
    kwargs = _short(task)
    batch = suite.load_batch(*task, 64, 4, _SEED, task_kwargs=kwargs)
    singles = [suite.load(*task, {"random": _SEED + i, **kwargs}) for i in range(64)]
    _play(task, batch, singles, 3 * _STEPS_OF_AN_EPISODE + 10)


@pytest.mark.parametrize("task", costly(TASKS))
def test_variants_reach_the_rows(task: Task) -> None:
    kwargs = _short(task)
    kwargs |= variant(task)
    environment = {"flat_observation": True, "legacy_step": False}
    batch = suite.load_batch(*task, 3, 2, _SEED, kwargs, environment)
    singles = [suite.load(*task, {"random": _SEED + i, **kwargs}, environment) for i in range(3)]
    _play(task, batch, singles, 40)


@pytest.mark.parametrize("task", TASKS)
def test_arrays_returned_by_a_batch_never_change_later(task: Task) -> None:
    batch = suite.load_batch(*task, 3, 1, _SEED)
    first = batch.reset()
    action = _actions(batch, 1)[0]
    before = {name: value.copy() for name, value in first.observation.items()}
    second = batch.step(action)
    kept = (second.reward.copy(), second.step_type.copy(), second.discount.copy())
    third = batch.step(-action)
    for name, value in first.observation.items():
        np.testing.assert_array_equal(value, before[name])
        assert not np.may_share_memory(value, third.observation[name])
    for old, array in zip(kept, (second.reward, second.step_type, second.discount), strict=True):
        np.testing.assert_array_equal(old, array)


@pytest.mark.parametrize("task", TASKS)
def test_specs_describe_the_time_steps(task: Task) -> None:
    batch = suite.load_batch(*task, 5, 1, _SEED)
    single = suite.load(*task)
    batch.reset()
    time_step = batch.step(batch.action_spec().generate_value())
    specs = batch.observation_spec()
    assert list(specs) == list(single.observation_spec())
    for name, spec in specs.items():
        spec.validate(time_step.observation[name])
        assert spec.shape == (5, *single.observation_spec()[name].shape)
    batch.reward_spec().validate(time_step.reward)
    batch.discount_spec().validate(time_step.discount)
    assert batch.action_spec().shape == (5, *single.action_spec().shape)


@pytest.mark.parametrize("task", TASKS)
def test_the_terms_of_the_reward_are_there_for_each_row(task: Task) -> None:
    batch = suite.load_batch(*task, 4, 1, _SEED)
    batch.reset()
    time_step = batch.step(np.zeros(batch.action_spec().shape))
    for name, value in batch.reward_terms.items():
        assert np.shape(value) == (4,), name
    if batch.reward_terms:  # else the task overrides get_reward
        reward = batch.task.reward_of(batch.reward_terms)
        np.testing.assert_array_equal(reward, time_step.reward)
    if batch.task.GOAL:
        assert np.shape(batch.task.is_success(batch.reward_terms)) == (4,)
