"""Tests of limberjack.suite.wrappers.action_noise."""

import copy
from types import SimpleNamespace
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.suite.wrappers import action_noise, action_scale


class Recorder(dm_env.Environment):
    """Keeps the actions that reach it; its task has a random stream."""

    def __init__(self, minimum: Any = -1.0, maximum: Any = 1.0, seed: int = 0) -> None:
        minimum, maximum = np.broadcast_arrays(np.atleast_1d(minimum), maximum)
        self.spec = specs.BoundedArray(minimum.shape, float, minimum, maximum)
        self.task = SimpleNamespace(random=np.random.RandomState(seed))
        self.actions: list[np.ndarray] = []

    def reset(self) -> dm_env.TimeStep:
        return dm_env.restart({})

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        self.actions.append(action)
        return dm_env.transition(reward=1.0, observation={})

    def action_spec(self) -> Any:
        return self.spec

    def observation_spec(self) -> Any:
        return {}


@pytest.mark.parametrize("scale", [0.0, 0.01, 0.5, [0.1, 0.2]])
def test_the_noise_is_a_fraction_of_the_range_from_the_tasks_stream(scale: Any) -> None:
    low, high = np.array([-1.0, 0.0]), np.array([1.0, 10.0])
    env = Recorder(low, high, seed=5)
    wrapped = action_noise.Wrapper(env, scale)
    actions = np.random.RandomState(1).uniform(low, high, (20, 2))
    for action in actions:
        wrapped.step(action)
    stream = np.random.RandomState(5)
    noise = [stream.normal(scale=np.asarray(scale) * (high - low)) for _ in actions]
    np.testing.assert_array_equal(env.actions, np.clip(actions + noise, low, high))


def test_noisy_actions_stay_within_the_bounds() -> None:
    env = Recorder([-1.0, 0.0], [1.0, 0.5])
    wrapped = action_noise.Wrapper(env, scale=10.0)
    for _ in range(50):
        wrapped.step([1.0, 0.0])
    got = np.array(env.actions)
    assert got.min(axis=0).tolist() == [-1.0, 0.0]
    assert got.max(axis=0).tolist() == [1.0, 0.5]


def test_a_stream_that_a_program_assigns_is_honoured() -> None:
    env = Recorder()
    wrapped = action_noise.Wrapper(env, scale=0.1)
    wrapped.task.random = np.random.RandomState(42)
    wrapped.step([0.0])
    np.testing.assert_array_equal(env.actions[0], np.random.RandomState(42).normal(scale=[0.2]))


def test_the_given_action_is_left_alone() -> None:
    action = np.array([0.5])
    action_noise.Wrapper(Recorder(), scale=0.1).step(action)
    assert action.tolist() == [0.5]


def test_everything_else_is_the_wrapped_environments() -> None:
    env = Recorder()
    wrapped = action_noise.Wrapper(env)
    assert wrapped.reset() == env.reset()
    assert wrapped.action_spec() is env.spec
    assert wrapped.observation_spec() == {}
    assert wrapped.task is env.task
    assert copy.copy(wrapped).task is env.task


@pytest.mark.parametrize("bound", [np.inf, np.nan])
def test_bounds_that_are_not_finite_are_refused(bound: float) -> None:
    env = Recorder()
    env.spec = SimpleNamespace(minimum=np.array([-1.0]), maximum=np.array([bound]))  # type: ignore[assignment]
    with pytest.raises(ValueError, match="expected finite bounds"):
        action_noise.Wrapper(env)


@pytest.mark.parametrize("scale", [-0.1, np.nan, np.inf, [0.1, -0.1]])
def test_a_scale_that_is_negative_or_not_finite_is_refused(scale: Any) -> None:
    with pytest.raises(ValueError, match="expected a finite fraction of at least 0"):
        action_noise.Wrapper(Recorder([-1.0, -1.0]), scale)


@pytest.mark.parametrize("scale", [[0.1], np.full((1, 2), 0.1)])
def test_a_scale_of_another_shape_is_refused(scale: Any) -> None:
    with pytest.raises(ValueError, match=r"scale has shape .*expected \(\) or \(2,\)"):
        action_noise.Wrapper(Recorder([-1.0, -1.0]), scale)


@pytest.mark.parametrize(
    ("action", "error", "message"),
    [
        (0.5, ValueError, r"shape \(\); expected \(2,\)"),
        ([[0.5, 0.5]], ValueError, r"shape \(1, 2\); expected \(2,\)"),
        ([0.5, np.nan], ValueError, r"not finite at index \[1\]"),
        (["a", "b"], TypeError, "expected numbers"),
    ],
)
def test_a_bad_action_neither_steps_nor_draws_noise(
    action: Any, error: type[Exception], message: str
) -> None:
    env, twin = Recorder([-1.0, -1.0]), Recorder([-1.0, -1.0])
    wrapped = action_noise.Wrapper(env, scale=0.1)
    with pytest.raises(error, match=message):
        wrapped.step(action)
    assert env.actions == []
    wrapped.step([0.0, 0.0])
    action_noise.Wrapper(twin, scale=0.1).step([0.0, 0.0])
    np.testing.assert_array_equal(env.actions, twin.actions)


def test_a_spec_without_dimensions_leaves_the_shape_to_the_environment() -> None:
    env = Recorder()
    env.spec = specs.BoundedArray((), float, -1.0, 1.0)
    action_noise.Wrapper(env, scale=0.0).step([0.5])
    np.testing.assert_array_equal(env.actions, [[0.5]])


def test_a_seed_fixes_noise_and_starts_of_a_task() -> None:
    def play() -> list[Any]:
        env = suite.load("stacker", "stack_2", {"random": 7})
        env = action_noise.Wrapper(action_scale.Wrapper(env, -2.0, 2.0), scale=0.1)
        steps = []
        for _ in range(2):
            steps.append(env.reset())
            steps += [env.step(np.zeros(5)) for _ in range(5)]
        return [np.concatenate([np.ravel(v) for v in s.observation.values()]) for s in steps]

    first, again = play(), play()
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], first[6])
