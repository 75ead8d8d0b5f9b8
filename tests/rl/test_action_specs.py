"""Action specs, checked against what tasks take, and checks of actions before a step."""

import importlib
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import gym, policies
from limberjack.rl.action_specs import (
    as_numbers,
    bounded_spec,
    bounds_to_try,
    check_finite,
    not_finite,
)
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


def test_a_misspelled_name_in_before_step_is_not_blamed_on_the_spec() -> None:
    class Misspelled(humanoid.Humanoid):
        def before_step(self, action: Any, physics: Any) -> None:
            super().before_step(action * physics.named.data.qpoz["root"], physics)

    env = humanoid.walk(random=0)
    env._task = Misspelled(move_speed=1, pure_state=False, random=0)
    with pytest.raises(AttributeError, match="qpoz"):
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
    with pytest.raises(ValueError, match=r"ByPose sets data.mocap_pos, data.mocap_quat in a step"):
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


def test_unlimited_actions_are_tried_within_another_bound() -> None:
    spec = specs.BoundedArray((4,), float, [-2, -np.inf, 5, -np.inf], [2, np.inf, np.inf, -4])
    low, high = bounds_to_try(spec, 3.0)
    assert (low.tolist(), high.tolist()) == ([-2, -3, 5, -10], [2, 3, 11, -4])


@pytest.mark.parametrize("dtype", [float, np.float32, np.int64, np.uint8, bool])
def test_finite_numbers_of_any_real_type_pass(dtype: type) -> None:
    check_finite(as_numbers(np.ones((2, 3), dtype)))


@pytest.mark.parametrize("bad", [np.array(["a"]), np.array([None]), np.array([1j])])
def test_an_action_that_is_not_of_real_numbers_is_a_type_error(bad: np.ndarray) -> None:
    with pytest.raises(TypeError, match=f"dtype {bad.dtype}"):
        as_numbers(bad)


@pytest.mark.parametrize("value", ["1e400", "-1e400", "inf"])
def test_a_wide_number_that_is_infinite_for_mujoco_is_refused(value: str) -> None:
    given = as_numbers(np.full((2, 3), np.longdouble(value)))
    assert given.dtype == float
    with pytest.raises(ValueError, match="not finite"):
        check_finite(given)
    check_finite(as_numbers(np.full(3, np.longdouble("1e300"))))
    assert as_numbers(np.full(3, np.longdouble("1e-4000"))).tolist() == [0.0] * 3


@pytest.mark.parametrize("dtype", [float, np.float32, np.float16, np.int8, np.uint64, bool])
def test_other_numbers_keep_their_type(dtype: type) -> None:
    action = np.ones(3, dtype)
    assert as_numbers(action) is action


@pytest.mark.parametrize(
    "bad", [[10**400], [10**400, 1.5], [2**70], [None, 1.0], [1 + 2j], "1", b"1", {}, object()]
)
def test_what_is_no_array_of_numbers_is_refused_in_one_sentence(bad: Any) -> None:
    with pytest.raises(
        (TypeError, ValueError), match=r"^action (has dtype|is) .*expected"
    ) as caught:
        as_numbers(bad)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_is_named_by_its_index(value: float) -> None:
    action = np.zeros((2, 3))
    action[1, 2] = value
    with pytest.raises(ValueError, match=r"not finite at index \[\[1, 2\]\]"):
        check_finite(action)
    np.testing.assert_array_equal(not_finite(action), [[False] * 3, [False, False, True]])
    with pytest.raises(ValueError, match=r"not finite at index \[2\]"):
        check_finite(action[1])


def test_finite_numbers_give_no_mask() -> None:
    assert not_finite(np.zeros(3)) is None
    assert not_finite(np.zeros(3, int)) is None


def test_ragged_actions_are_refused() -> None:
    with pytest.raises(ValueError, match="expected an array of numbers"):
        as_numbers([[1, 2, 3], [4]])
    assert as_numbers([[1, 2], [3, 4]]).shape == (2, 2)


class _Delayed(humanoid.Humanoid):
    """Actions wait in a queue for a few steps."""

    def initialize_episode(self, physics: Any) -> None:
        super().initialize_episode(physics)
        self.queue = [np.zeros(physics.model.nu) for _ in range(3)]

    def before_step(self, action: Any, physics: Any) -> None:
        self.queue.append(np.array(action))
        super().before_step(self.queue.pop(0), physics)


def test_actions_may_reach_the_actuators_later() -> None:
    env = humanoid.walk(random=0)
    env._task = _Delayed(move_speed=1, pure_state=False, random=0)
    assert bounded_spec(env.task, env.physics).shape == (21,)
