"""`bounded_spec`: tasks whose actions differ from the controls must define an action spec."""

import importlib
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import gym, policies
from limberjack.rl.action_specs import bounded_spec, bounds_to_try
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import humanoid
from tests import two_arms

_TASKS = pytest.mark.parametrize(
    ("make", "size"), [(two_arms.by_joints, 14), (two_arms.by_pose, 16)]
)


def _ours(name: str) -> Any:
    return importlib.import_module(f"limberjack.{name}")


def _spec(size: int) -> specs.BoundedArray:
    return specs.BoundedArray((size,), float, -0.5, 0.5)


@_TASKS
def test_an_environment_steps_with_the_actions_of_its_task(make: Any, size: int) -> None:
    env = make(_ours)
    env.reset()
    assert env.step(np.linspace(-0.5, 0.5, size)).mid()


@_TASKS
@pytest.mark.parametrize(
    "use",
    [
        lambda env: gym.Env(env),
        lambda env: BatchEnvironment.from_environment(env, 2, 1),
        lambda env: policies.find("random").begin_alone(env, 0),
        lambda env: policies.find("zero").begin_alone(env, 0),
    ],
    ids=["Gymnasium", "a batch", "random", "zero"],
)
def test_agents_are_refused_a_spec_that_the_task_does_not_follow(
    use: Any, make: Any, size: int
) -> None:
    env = make(_ours)
    env.reset()
    stream = env.task.random.get_state()[1].tolist()
    state = env.physics.get_state().tolist()
    with pytest.raises(ValueError, match=r"defines before_step but not action_spec.*define action"):
        use(env)
    assert env.task.random.get_state()[1].tolist() == stream
    assert env.physics.get_state().tolist() == state


def test_the_error_names_the_problem_with_the_inherited_spec() -> None:
    env = two_arms.by_joints(_ours)
    with pytest.raises(ValueError, match=r"\(16,\), is not what it takes: number \[14\]"):
        bounded_spec(env.task, env.physics)
    env = two_arms.by_pose(_ours)
    with pytest.raises(ValueError, match=r"\(4,\), makes before_step raise ValueError: "):
        bounded_spec(env.task, env.physics)


@_TASKS
def test_gymnasium_and_random_policies_act_by_the_spec_that_a_task_defines(
    make: Any, size: int
) -> None:
    env = make(_ours, _spec(size))
    assert gym.Env(env).action_space.shape == (size,)
    env.reset()
    assert policies.find("random").begin_alone(env, 0)({}).shape == (size,)


@pytest.mark.parametrize("num_envs", [3, 130])
def test_rows_of_a_batch_take_the_actions_that_a_task_defines(num_envs: int) -> None:
    def make(seed: int) -> Any:
        env = two_arms.by_joints(_ours, _spec(14))
        env.reseed(seed)
        return env

    batch = BatchEnvironment.from_environment(make(0), num_envs, 1, seed=5)
    singles = [make(5 + row) for row in range(num_envs)]
    batch.reset()
    for single in singles:
        single.reset()
    for actions in np.random.RandomState(0).uniform(-0.5, 0.5, (6, num_envs, 14)):
        batched = batch.step(actions)
        for row, single in enumerate(singles):
            alone = single.step(actions[row])
            assert batched.reward[row] == alone.reward
            np.testing.assert_array_equal(
                batched.observation["qpos"][row], alone.observation["qpos"]
            )


def test_a_batch_refuses_actions_that_move_mocap_bodies() -> None:
    # A single simulation's step begins with what was computed before they moved; a batch's rows
    # begin with their states.
    env = two_arms.by_pose(_ours, _spec(16))
    with pytest.raises(ValueError, match="mocap bodies can be set only at an episode's start"):
        BatchEnvironment.from_environment(env, 3, 1)


def test_a_task_may_change_the_values_of_its_actions_without_a_spec() -> None:
    class Weak(humanoid.Humanoid):
        def before_step(self, action: Any, physics: Any) -> None:
            super().before_step(np.tanh(action) / 2, physics)

    env = humanoid.walk(random=0)
    env._task = Weak(move_speed=1, pure_state=False, random=0)
    assert gym.Env(env).action_space.shape == (21,)
    assert BatchEnvironment.from_environment(env, 2, 1).action_spec().shape == (2, 21)


def test_a_nested_spec_is_refused_to_agents_by_name() -> None:
    env = humanoid.walk(random=0)
    env.task.action_spec = lambda physics: {"torque": _spec(21)}
    for use in (gym.Env, lambda env: BatchEnvironment.from_environment(env, 2, 1)):
        with pytest.raises(TypeError, match=r"action_spec of task Humanoid is {'torque'.*Bounded"):
            use(env)


@pytest.mark.parametrize(
    ("minimum", "maximum", "expected"),
    [
        (-2.0, 3.0, (-2.0, 3.0)),
        (-1e10, 1e10, (-1.0, 1.0)),
        (-np.inf, np.inf, (-1.0, 1.0)),
        (5.0, np.inf, (5.0, 7.0)),
        (-1e10, -4.0, (-6.0, -4.0)),
    ],
)
def test_unlimited_actions_are_tried_between_minus_1_and_1(
    minimum: float, maximum: float, expected: tuple[float, float]
) -> None:
    low, high = bounds_to_try(specs.BoundedArray((2,), float, minimum, maximum))
    assert (low.tolist(), high.tolist()) == ([expected[0]] * 2, [expected[1]] * 2)
