"""The policy that a name or a Python object stands for."""

import contextlib
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from dm_env import specs

from limberjack import gym, policies, suite
from tests.evaluation import evaluated

_SPEC = specs.BoundedArray((21,), float, -1.0, 1.0)
_ENVIRONMENT: Any = SimpleNamespace(action_spec=lambda: _SPEC)
_OBSERVATION = {"extremities": np.full(12, 0.1), "head_height": np.array(1.2)}


def test_the_names_of_built_in_policies_stand_for_them() -> None:
    found = [policies.find(name) for name in policies.BUILT_IN]
    assert [actor.name for actor in found] == ["zero", "random", "planner", "pretrained"]
    assert [actor.plays_alone for actor in found] == [False, False, True, True]
    assert not found[0].begin_alone(_ENVIRONMENT, 0)(_OBSERVATION).any()


@pytest.mark.parametrize("name", ["linear", "Linear", "Network"])
def test_a_policy_may_be_given_by_name_or_as_itself(name: str) -> None:
    by_name = policies.find(f"evaluated:{name}").begin_alone(_ENVIRONMENT, 3)
    at_hand = policies.find(getattr(evaluated, name)).begin_alone(_ENVIRONMENT, 3)
    np.testing.assert_array_equal(by_name(_OBSERVATION), at_hand(_OBSERVATION))


def test_a_policy_on_batches_needs_a_reset_for_rows() -> None:
    with pytest.raises(policies.PolicyError, match=r"write reset_batch\(rows, seeds\)"):
        policies.find("evaluated:Forgetful")


@pytest.mark.parametrize("policy", ["pretrained", "zero"])
def test_an_environment_of_gymnasium_is_refused_by_its_type(policy: str) -> None:
    with (
        contextlib.closing(gym.Env(suite.load("cartpole", "swingup"))) as environment,
        pytest.raises(TypeError, match=r"environment is of type Env; expected a dm_env\.Env"),
    ):
        policies.find(policy, cast(Any, environment))


def test_an_object_with_the_state_of_episodes_is_copied_where_others_use_it_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[object] = []

    class Counting:
        def reset(self) -> None:
            begun.append(self)

        def act(self, observation: object) -> np.ndarray:
            return np.zeros(21)

    one = Counting()
    monkeypatch.setattr(evaluated, "one", one, raising=False)
    for is_shared in (False, True):
        policies.find(f"{evaluated.__name__}:one", is_shared=is_shared).begin_alone(_ENVIRONMENT, 0)
    assert begun[0] is one
    assert begun[1] is not one


def test_other_objects_are_refused() -> None:
    with pytest.raises(policies.PolicyError, match="is of type int; expected a function of an"):
        policies.find(3)
