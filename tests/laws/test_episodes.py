"""Episodes of any task are reproducible, last for the time limit and conform to the specs."""

import collections
import unittest
from typing import Any

import dm_env
import mujoco
import numpy as np
import pytest
from dm_env import specs, test_utils

from limberjack import registry, suite
from limberjack.rl.reward_terms import reward_and_terms

from .episodes import LAST_TASKS, TASKS, Task, actions, bits, costly, load, play, short, snapshot

# Tasks whose whole episodes are played, of many lengths and control steps. The other tasks' are in
# the long comparison with dm_control.
_WHOLE = set(LAST_TASKS)
_SHORT = 50  # steps
_CONTRACT = [name for name in dir(test_utils.EnvironmentTestMixin) if name.startswith("test_")]


@pytest.mark.parametrize("task", TASKS)
def test_dm_envs_own_contract_holds(task: Task) -> None:
    class Contract(test_utils.EnvironmentTestMixin, unittest.TestCase):
        def make_object_under_test(self, **unused_kwargs: Any) -> dm_env.Environment:
            # The end of the episode is within reach.
            time_limit = 12 * load(task).control_timestep()
            return suite.load(*task, {"random": 0, "time_limit": time_limit})

        def make_action_sequence(self) -> Any:
            return iter(actions(self.environment, 20))

    for name in _CONTRACT:
        result = unittest.TestResult()
        Contract(name).run(result)
        assert result.testsRun == 1
        assert result.wasSuccessful(), [*result.errors, *result.failures]


@pytest.mark.parametrize("task", TASKS)
def test_the_same_seed_and_actions_give_the_same_bits_and_others_do_not(task: Task) -> None:
    env = load(task, seed=5)
    episodes = [play(env, 30), play(env, 30)]
    twin = load(task, seed=5)
    assert [play(twin, 30), play(twin, 30)] == episodes
    assert episodes[0][0] != episodes[1][0], "the second episode starts as the first"
    assert play(load(task, seed=6), 1)[0] != episodes[0][0], "the seed changes nothing"
    other = load(task, seed=5)
    assert play(other, 30, seed=1)[1:] != episodes[0][1:], "the actions change nothing"


@pytest.mark.parametrize("task", costly(TASKS))
def test_environments_do_not_see_each_other(task: Task) -> None:
    alone = [play(load(task, seed), 20, seed) for seed in range(3)]
    envs = [load(task, seed) for seed in range(3)]
    together = [[bits(env.reset())] for env in envs]
    for step in range(20):
        for seed, env in enumerate(envs):
            together[seed].append(bits(env.step(actions(env, 20, seed)[step])))
    assert together == alone


@pytest.mark.parametrize("task", TASKS)
def test_an_episode_ends_at_the_time_limit_with_discount_1(task: Task) -> None:
    env = load(task)
    assert env.step_limit == registry.steps(*task)
    if task not in _WHOLE or env.step_limit is None:
        env = suite.load(*task, {"random": 0, **short(task, _SHORT)})
        assert env.step_limit == _SHORT
    steps = [env.reset()]
    action = np.zeros(env.action_spec().shape)
    while not steps[-1].last():
        steps.append(env.step(action))
    limit = env.step_limit
    assert len(steps) - 1 == limit
    assert steps[0].first()
    assert all(step.mid() for step in steps[1:-1])
    assert all(step.discount == 1.0 for step in steps[1:])
    assert env.physics.time() == pytest.approx(limit * env.control_timestep())
    assert env.step(action).first()
    assert env.physics.time() == 0.0


@pytest.mark.parametrize("task", TASKS)
def test_a_step_before_the_first_reset_begins_an_episode(task: Task) -> None:
    env, twin = load(task), load(task)
    assert bits(env.step(actions(env, 1)[0])) == bits(twin.reset())
    assert play(env, 5, reset=False) == play(twin, 5, reset=False)


@pytest.mark.parametrize("task", TASKS)
def test_every_observation_is_finite_and_conforms_to_its_spec(task: Task) -> None:
    env = load(task)
    spec = env.observation_spec()
    assert isinstance(spec, collections.OrderedDict)
    for step in [env.reset(), *map(env.step, actions(env, 20))]:
        assert type(step.observation) is collections.OrderedDict
        assert list(step.observation) == list(spec)
        for name, value in step.observation.items():
            spec[name].validate(value)
            assert spec[name].dtype == float
            assert np.isfinite(value).all(), name


@pytest.mark.parametrize("task", TASKS)
def test_queries_change_nothing(task: Task) -> None:
    env, twin = load(task), load(task)
    for begin in (lambda env: None, lambda env: play(env, 2)):
        begin(env), begin(twin)
        before = snapshot(env)
        for ask in (env.action_spec, env.observation_spec, env.reward_spec, env.discount_spec):
            assert ask() == ask()
        env.control_timestep(), env.physics.timestep(), env.physics.time()
        env.task.start(env.physics), reward_and_terms(env.task, env.physics)
        env.task.get_observation(env.physics), env.task.get_reward(env.physics)
        assert snapshot(env) == before
        assert play(env, 3, reset=False) == play(twin, 3, reset=False)


@pytest.mark.parametrize("task", TASKS)
def test_a_flat_observation_is_the_parts_in_their_order(task: Task) -> None:
    env, flat = load(task), load(task, flat_observation=True)
    steps = zip(
        [env.reset(), *map(env.step, actions(env, 3))],
        [flat.reset(), *map(flat.step, actions(flat, 3))],
        strict=True,
    )
    for step, flat_step in steps:
        parts = [np.ravel(value) for value in step.observation.values()]
        assert list(flat_step.observation) == ["observations"]
        np.testing.assert_array_equal(flat_step.observation["observations"], np.hstack(parts))
        assert (step.reward, step.step_type) == (flat_step.reward, flat_step.step_type)


@pytest.mark.parametrize("task", TASKS)
def test_actions_are_bounded_as_the_actuators_and_reach_them(task: Task) -> None:
    env = load(task)
    spec = env.action_spec()
    assert isinstance(spec, specs.BoundedArray)
    assert spec.shape == (env.physics.model.nu,)
    model = env.physics.model
    unlimited = [-mujoco.mjMAXVAL, mujoco.mjMAXVAL]
    bounds = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, unlimited)
    np.testing.assert_array_equal(np.stack([spec.minimum, spec.maximum], axis=-1), bounds)
    env.reset()
    action = actions(env, 1)[0]
    env.step(action)
    np.testing.assert_array_equal(env.physics.control(), action)


@pytest.mark.parametrize("task", TASKS)
def test_a_task_stores_nothing_about_an_episode(task: Task) -> None:
    env = load(task)
    before = dict(vars(env.task))
    play(env, 5)
    env.reset()
    after = vars(env.task)
    assert list(after) == list(before)
    for name, value in before.items():
        assert after[name] is value, name  # the stream is the same object, in another state


@pytest.mark.parametrize("task", TASKS)
def test_an_assigned_or_reseeded_stream_is_honoured_at_the_next_reset(task: Task) -> None:
    expected = play(load(task, seed=3), 5)
    env = load(task, seed=0)
    play(env, 5)
    env.reseed(3)
    assert play(env, 5) == expected
    if env.task.begin_stream(np.random.RandomState(0)):
        return  # assigned streams keep the model, as in dm_control; the oracle compares them
    env.task._random = np.random.RandomState(3)
    assert play(env, 5) == expected
    env.task.random.seed(3)
    assert play(env, 5) == expected


@pytest.mark.parametrize("task", TASKS)
def test_a_stream_given_instead_of_a_seed_is_used_directly(task: Task) -> None:
    stream = np.random.RandomState(3)
    env = suite.load(*task, {"random": stream})
    assert env.task.random is stream
    assert play(env, 3) == play(load(task, seed=3), 3)


def test_without_a_seed_starts_differ() -> None:
    first, second = (suite.load("humanoid", "stand").reset() for _ in range(2))
    assert bits(first) != bits(second)
