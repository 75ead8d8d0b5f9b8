"""The types of policies."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.policies import kinds


def test_a_policy_of_environments_cannot_be_begun_with_a_spec() -> None:
    environment = suite.load("humanoid", "stand")
    policy = kinds.EnvironmentPolicy(lambda environment, seed: lambda observation: np.zeros(21))
    assert policy.begin_in(environment, 0)({}).shape == (21,)
    with pytest.raises(kinds.PolicyError, match=r"policies\.begin\(policy, environment, seed\)"):
        policy(environment.action_spec(), 0)


def test_an_error_of_a_policy_is_a_value_error() -> None:
    assert issubclass(kinds.PolicyError, ValueError)
