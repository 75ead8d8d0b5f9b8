"""The wrappers' base class: delegation, and action checks."""

import copy
import pickle
from typing import Any

import dm_env
import numpy as np
import pytest
from dm_env import specs

from limberjack import suite
from limberjack.suite.wrappers._delegating import Wrapper, checked_action


class _Environment(dm_env.Environment):
    """Records its calls."""

    def __init__(self) -> None:
        self.asked: list[Any] = []
        self.extra = "extra"

    def reset(self) -> dm_env.TimeStep:
        self.asked.append("reset")
        return dm_env.restart({"x": 1.0})

    def step(self, action: Any) -> dm_env.TimeStep:
        self.asked.append(action)
        return dm_env.transition(2.0, {"x": 3.0})

    def action_spec(self) -> Any:
        return specs.BoundedArray((2,), float, -1, 1, "action")

    def observation_spec(self) -> Any:
        return {"x": specs.Array((), float)}

    def reward_spec(self) -> Any:
        return specs.Array((), np.float32, "reward")

    def discount_spec(self) -> Any:
        return specs.BoundedArray((), float, 0, 0.5, "discount")

    def close(self) -> None:
        self.asked.append("close")


def test_everything_reaches_the_wrapped_environment_and_comes_back() -> None:
    inner = _Environment()
    outer = Wrapper(inner)
    assert outer.reset().first()
    assert outer.step("an action").reward == 2.0  # pyright: ignore[reportArgumentType]
    assert outer.action_spec().name == "action"
    assert outer.observation_spec() == {"x": specs.Array((), float)}
    assert outer.reward_spec().dtype == np.float32
    assert outer.discount_spec().maximum == 0.5
    outer.close()
    assert inner.asked == ["reset", "an action", "close"]
    assert outer.extra == "extra"


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))]
)
def test_a_copy_delegates_to_what_it_wraps(copied: Any) -> None:
    assert copied(Wrapper(_Environment())).extra == "extra"


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nothing"):
        _ = Wrapper(_Environment()).nothing


def test_numbers_of_the_right_shape_pass() -> None:
    assert checked_action([1, 2], (2,)).tolist() == [1, 2]
    assert checked_action([[1.0], [2.0]], ()).shape == (2, 1)  # the environment knows the shape


@pytest.mark.parametrize(
    ("action", "error", "message"),
    [
        (["a", "b"], TypeError, "dtype <U1"),
        ([1, 2, 3], ValueError, r"shape \(3,\); expected \(2,\)"),
        ([[1], [2, 3]], ValueError, r"expected an array of numbers"),
        ([np.nan, 1.0], ValueError, r"not finite at index \[0\]"),
        ([1.0, -np.inf], ValueError, r"not finite at index \[1\]"),
    ],
)
def test_invalid_actions_are_refused(action: Any, error: Any, message: str) -> None:
    with pytest.raises(error, match=message):
        checked_action(action, (2,))


def test_a_deep_copy_is_of_the_wrapper_not_only_of_what_it_wraps() -> None:
    env = Wrapper(suite.load("cartpole", "swingup", task_kwargs={"random": 0}))
    twin = copy.deepcopy(env)
    assert type(twin) is Wrapper
    assert twin._env is not env._env
    assert twin.physics is not env.physics
