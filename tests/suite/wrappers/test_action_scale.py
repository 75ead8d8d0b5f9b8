"""Tests of limberjack.suite.wrappers.action_scale."""

import copy
import pickle
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.suite.wrappers import action_scale


class Recorder(dm_env.Environment):
    """Keeps the actions that reach it."""

    def __init__(self, minimum: Any = -1.0, maximum: Any = 1.0, dtype: type = float) -> None:
        minimum, maximum = np.broadcast_arrays(np.atleast_1d(minimum), maximum)
        self.spec = specs.BoundedArray(minimum.shape, dtype, minimum, maximum, name="torques")
        self.actions: list[np.ndarray] = []
        self.is_closed = False
        self.extra = "an attribute of its own"

    def reset(self) -> dm_env.TimeStep:
        return dm_env.restart({"x": 0.0})

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        self.actions.append(action)
        return dm_env.transition(reward=1.0, observation={"x": 1.0})

    def action_spec(self) -> Any:
        return self.spec

    def observation_spec(self) -> Any:
        return {"x": specs.Array((), float)}

    def reward_spec(self) -> specs.Array:
        return specs.Array((), np.float32, name="its own reward")

    def discount_spec(self) -> Any:
        return specs.Array((), np.float32, name="its own discount")

    def close(self) -> None:
        self.is_closed = True


@pytest.mark.parametrize(
    ("minimum", "maximum"), [(-2.0, 2.0), ([-2, 0], [2, 3]), (0, [1, 10]), (-0.5, 0.25)]
)
def test_the_new_bounds_reach_the_old_ones(minimum: Any, maximum: Any) -> None:
    env = Recorder([-1.0, 10.0], [1.0, 30.0])
    wrapped = action_scale.Wrapper(env, minimum, maximum)
    low, high = np.broadcast_to(minimum, (2,)), np.broadcast_to(maximum, (2,))
    for action in (low, high, (low + high) / 2):
        wrapped.step(action)
    np.testing.assert_array_equal(env.actions, [[-1.0, 10.0], [1.0, 30.0], [0.0, 20.0]])


def test_the_spec_has_the_new_bounds_and_the_old_name() -> None:
    spec = action_scale.Wrapper(Recorder([-2.0, -3.0], 2.0), [0, 1], [2, 3]).action_spec()
    np.testing.assert_array_equal(spec.minimum, [0, 1])
    np.testing.assert_array_equal(spec.maximum, [2, 3])
    assert (spec.shape, spec.dtype, spec.name) == ((2,), np.dtype(float), "torques")


def test_the_wrapped_environment_gets_its_own_dtype() -> None:
    env = Recorder(dtype=np.float32)
    wrapped = action_scale.Wrapper(env, minimum=0.0, maximum=1.0)
    wrapped.step(np.array([0.3]))
    assert env.actions[0].dtype == np.float32
    assert wrapped.action_spec().dtype == np.float64


def test_actions_beyond_the_bounds_are_scaled_not_clipped() -> None:
    env = Recorder()
    action_scale.Wrapper(env, minimum=0.0, maximum=1.0).step([2.0])
    np.testing.assert_array_equal(env.actions, [[3.0]])


def test_the_given_action_and_bounds_are_left_alone() -> None:
    low, high, action = np.array([0.0]), np.array([1.0]), np.array([0.5])
    wrapped = action_scale.Wrapper(Recorder(), low, high)
    wrapped.step(action)
    low[:] = high[:] = 7.0
    assert action.tolist() == [0.5]
    assert wrapped.action_spec().minimum.tolist() == [0.0]


def test_everything_else_is_the_wrapped_environments() -> None:
    env = Recorder()
    wrapped = action_scale.Wrapper(env, minimum=0, maximum=1)
    assert wrapped.reset() == env.reset()
    assert wrapped.step([0.5]) == env.step(np.zeros(1))
    assert wrapped.observation_spec() == env.observation_spec()
    assert wrapped.reward_spec() == env.reward_spec()
    assert wrapped.discount_spec() == env.discount_spec()
    assert wrapped.extra == "an attribute of its own"
    assert wrapped._env is env
    with pytest.raises(AttributeError, match="nothing_like_it"):
        _ = wrapped.nothing_like_it
    with wrapped:
        pass
    assert env.is_closed


def test_a_wrapper_can_be_copied_and_pickled() -> None:
    wrapped = action_scale.Wrapper(Recorder(), minimum=0, maximum=1)
    for twin in (copy.copy(wrapped), copy.deepcopy(wrapped), pickle.loads(pickle.dumps(wrapped))):
        twin.step([1.0])
        np.testing.assert_array_equal(twin.actions[-1], [1.0])


def test_a_spec_that_is_not_one_bounded_array_is_refused() -> None:
    env = Recorder()
    for spec in ([env.spec, env.spec], specs.Array((1,), float)):
        env.spec = spec  # type: ignore[assignment]
        with pytest.raises(ValueError, match=r"expected one dm_env\.specs\.BoundedArray"):
            action_scale.Wrapper(env, minimum=0, maximum=1)


@pytest.mark.parametrize("bad", [np.nan, np.inf, [0.0, -np.inf]])
def test_bounds_that_are_not_finite_are_refused(bad: Any) -> None:
    env = Recorder([-1.0, -1.0])
    with pytest.raises(ValueError, match=r"minimum is .*expected finite"):
        action_scale.Wrapper(env, minimum=bad, maximum=1)
    with pytest.raises(ValueError, match=r"maximum is .*expected finite"):
        action_scale.Wrapper(env, minimum=-1, maximum=bad)


def test_an_environment_without_finite_bounds_is_refused() -> None:
    with pytest.raises(ValueError, match=r"env.action_spec\(\).maximum is .*expected finite"):
        action_scale.Wrapper(Recorder(maximum=np.inf), minimum=0, maximum=1)


@pytest.mark.parametrize("bad", [np.zeros(3), np.zeros((2, 1))])
def test_bounds_of_another_shape_are_refused(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match=r"action's shape \(2,\)"):
        action_scale.Wrapper(Recorder([-1.0, -1.0]), minimum=bad - 1, maximum=1)


@pytest.mark.parametrize(("minimum", "maximum"), [(1, 1), (2, 1), ([0, 1], [1, 1])])
def test_bounds_without_a_range_between_them_are_refused(minimum: Any, maximum: Any) -> None:
    with pytest.raises(ValueError, match="expected minimum < maximum"):
        action_scale.Wrapper(Recorder([-1.0, -1.0]), minimum, maximum)


@pytest.mark.parametrize(
    ("action", "error", "message"),
    [
        (0.5, ValueError, r"shape \(\); expected \(2,\)"),
        ([0.5], ValueError, r"shape \(1,\); expected \(2,\)"),
        ([[0.5, 0.5]], ValueError, r"shape \(1, 2\); expected \(2,\)"),
        ([0.5, np.nan], ValueError, r"not finite at index \[1\]"),
        ([np.inf, 0.5], ValueError, r"not finite at index \[0\]"),
        (["a", "b"], TypeError, "expected numbers"),
        (None, TypeError, "expected numbers"),
        ([[0.5], 0.5], ValueError, "expected an array of numbers"),
    ],
)
def test_a_bad_action_does_not_reach_the_environment(
    action: Any, error: type[Exception], message: str
) -> None:
    env = Recorder([-1.0, -1.0])
    with pytest.raises(error, match=message):
        action_scale.Wrapper(env, minimum=0, maximum=1).step(action)
    assert env.actions == []


def test_a_scaled_task_goes_as_the_task_itself() -> None:
    plain, scaled = (suite.load("manipulator", "bring_ball", {"random": 3}) for _ in range(2))
    scaled = action_scale.Wrapper(scaled, minimum=0.0, maximum=2.0)
    assert scaled.physics.model.nu == 5
    plain.reset()
    scaled.reset()
    for action in np.random.RandomState(0).uniform(-1, 1, (10, 5)).round(3):
        shifted = action + 1.0
        expected, got = plain.step(shifted - 1.0), scaled.step(shifted)
        assert got.reward == expected.reward
        for name, value in expected.observation.items():
            np.testing.assert_array_equal(got.observation[name], value)


@pytest.mark.parametrize("action", [0.5, [[0.5]]])
def test_one_number_for_one_actuator_may_have_any_shape(action: Any) -> None:
    found = []
    for given in (action, [0.5]):
        environment = action_scale.Wrapper(
            suite.load("cartpole", "swingup", {"random": 0}), minimum=-2.0, maximum=2.0
        )
        environment.reset()
        found.append(environment.step(given).reward)
    assert found[0] == found[1]
