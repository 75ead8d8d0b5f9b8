"""Zero, random and the planner, and the beginning of an episode."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from dm_env import specs

from limberjack import policies, suite

_SPEC = specs.BoundedArray((3,), float, [-1.0, 0.5, -3.0], [1.0, 2.0, -1.0])


def test_zero_is_the_action_nearest_to_zero() -> None:
    act = policies.zero(_SPEC, 0)
    np.testing.assert_array_equal(act({}), [0.0, 0.5, -1.0])


def test_random_actions_fill_the_bounds() -> None:
    act = policies.random(_SPEC, 0)
    actions = np.array([act({}) for _ in range(2000)])
    assert (actions >= _SPEC.minimum).all()
    assert (actions <= _SPEC.maximum).all()
    # 2,000 uniform draws leave a gap of 1 % at an end with a probability of 2e-9.
    np.testing.assert_allclose(actions.min(axis=0), _SPEC.minimum, atol=0.02)
    np.testing.assert_allclose(actions.max(axis=0), _SPEC.maximum, atol=0.02)


def test_actions_are_whole_numbers_where_those_of_the_spec_are() -> None:
    spec = specs.BoundedArray((2,), np.int32, [-3, 1], [-1, 3])
    environment: Any = SimpleNamespace(action_spec=lambda: spec)
    act = policies.find("zero").begin_alone(environment, 0)
    assert act({}).dtype == np.int32
    assert act({}).tolist() == [-1, 1]
    act = policies.find("random").begin_alone(environment, 0)
    actions = np.array([act({}) for _ in range(3000)])
    assert actions.dtype == np.int32
    for column, first in zip(actions.T, (-3, 1), strict=True):
        numbers, counts = np.unique(column, return_counts=True)
        assert numbers.tolist() == [first, first + 1, first + 2]
        assert counts.min() > 850  # six deviations below 1,000


def test_random_actions_depend_on_the_seed_alone() -> None:
    def draw(seed: int) -> list[list[float]]:
        act = policies.random(_SPEC, seed)
        return [act({}).tolist() for _ in range(3)]

    assert draw(5) == draw(5)
    assert draw(5) != draw(6)


def test_random_actions_are_those_of_earlier_versions_and_not_the_stream_of_starts() -> None:
    first = policies.random(_SPEC, 5)({})
    # Stored results name the policy by its function's text, which says nothing of this number.
    stream = np.random.RandomState([5, 1])
    assert first.tolist() == stream.uniform(_SPEC.minimum, _SPEC.maximum).tolist()
    assert first.tolist() != np.random.RandomState(5).uniform(_SPEC.minimum, _SPEC.maximum).tolist()


def test_the_planner_acts_in_the_environment_that_it_is_begun_in() -> None:
    environment = suite.load("manipulator", "bring_ball", {"random": 0})
    environment.reset()
    planner = policies.planner(num_threads=1)
    assert planner.plays_alone
    action = planner.begin_alone(environment, 0)({})
    assert action.shape == environment.action_spec().shape


def test_the_planner_is_refused_a_task_that_it_has_no_cost_for() -> None:
    environment = suite.load("lqr", "lqr_2_1")
    environment.task.planner_cost = None
    with pytest.raises(policies.PolicyError, match="policy 'planner': "):
        policies.find("planner", environment)
    with pytest.raises(policies.PolicyError, match="policy 'planner': "):
        policies.find("planner").begin_alone(environment, 0)


def test_random_actions_of_an_unlimited_actuator_lie_between_minus_1_and_1() -> None:
    act = policies.random(specs.BoundedArray((2,), float, -1e10, 1e10), 0)
    actions = np.array([act({}) for _ in range(200)])
    assert -1 <= actions.min() < -0.9
    assert 0.9 < actions.max() <= 1


@pytest.mark.parametrize(
    "error",
    [
        FileNotFoundError(2, "No such file or directory", "<stdin>"),
        TypeError("<module '__main__' (<stdin>)> is a built-in module"),  # of `inspect`
    ],
)
def test_a_cost_whose_source_cannot_be_read_is_named(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    environment = suite.load("manipulator", "bring_ball", {"random": 0})
    monkeypatch.setattr("limberjack.policies.built_in.hash_of_files", _raising(error))
    with pytest.raises(policies.PolicyError, match=r"cost cannot be read .*stdin.*: define it in"):
        policies.find("planner", environment)


def _raising(error: Exception) -> Any:
    def fail(*given: object) -> None:
        raise error

    return fail
