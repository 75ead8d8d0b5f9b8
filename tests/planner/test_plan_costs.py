"""The costs of plans that were rolled out, by step and by plan."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from limberjack.planner import Cost
from limberjack.planner.cost import FunctionCost
from limberjack.planner.plan_costs import PlanCosts

_STEPS, _SAMPLES = 3, 4
_NOW: Any = None  # the single simulation, which no cost here reads unless it raises


class _Numbered(Cost):
    """A cost that is the number of the state, and at the horizon a hundred times the plan's."""

    weights = {"number": 2.0}  # noqa: RUF012 (as a user writes it)

    def terms(self, physics: Any) -> dict[str, Any]:
        return {"number": physics.numbers, "one": 1.0}

    def terminal(self, physics: Any) -> np.ndarray:
        return 100.0 * physics.numbers


def _rollouts(is_complete: bool = True) -> Any:
    """Rollouts whose states, steps first, are numbers: only what costs read of them."""
    states = _STEPS * _SAMPLES
    seen = SimpleNamespace(num_envs=states, numbers=np.arange(float(states)))
    at_horizon = SimpleNamespace(num_envs=_SAMPLES, numbers=np.arange(float(_SAMPLES)))
    return SimpleNamespace(
        seen=seen,
        at_horizon=at_horizon,
        history=SimpleNamespace(num_envs=states, is_complete=is_complete),
        simulation=SimpleNamespace(num_envs=_SAMPLES),
    )


def test_a_plan_costs_the_mean_of_its_steps_and_what_is_terminal() -> None:
    diverged = np.array([False, False, True, False])
    found = PlanCosts(_Numbered(None), _NOW).of(_rollouts(), diverged)
    # Plan 1 has the states 1, 5 and 9.
    np.testing.assert_array_equal(found, [9.0, 111.0, np.inf, 315.0])


def test_the_terms_of_one_plan_are_those_of_its_states() -> None:
    terms = PlanCosts(_Numbered(None), _NOW).terms_of(_rollouts(), 1)
    assert terms == {"number": 10.0, "one": 1.0, "terminal": 100.0}


def test_states_that_were_not_recorded_have_no_cost_yet() -> None:
    assert PlanCosts(_Numbered(None), _NOW).of(_rollouts(False), np.zeros(4, bool)) is None


def test_plans_that_all_diverge_are_no_mistake_of_the_cost() -> None:
    found = PlanCosts(_Numbered(None), _NOW).of(_rollouts(), np.ones(4, bool))
    assert found is not None
    assert np.isinf(found).all()


def test_terms_that_are_finite_only_in_plans_that_diverged_are_named() -> None:
    class Broken(_Numbered):
        def terms(self, physics: Any) -> dict[str, Any]:
            lost = np.where(physics.numbers % 4 == 2, 0.0, np.inf)
            return {"number": physics.numbers, "lost": lost}

    diverged = np.array([False, False, True, False])
    with pytest.raises(ValueError, match="no plan has a finite cost: 'lost' of Broken is inf"):
        PlanCosts(Broken(None), _NOW).of(_rollouts(), diverged)


def test_a_sum_that_is_not_finite_though_its_terms_are_is_named() -> None:
    class Summed(_Numbered):
        def step_cost(self, physics: Any) -> np.ndarray:
            return np.full(physics.num_envs, np.nan)

    with pytest.raises(ValueError, match="no plan has a finite cost: step_cost of Summed"):
        PlanCosts(Summed(None), _NOW).of(_rollouts(), np.zeros(4, bool))


def test_a_function_has_one_number_for_each_state_and_a_class_may_have_one() -> None:
    function = FunctionCost(lambda physics: {"number": physics.numbers, "one": np.ones(())})
    with pytest.raises(ValueError, match=r"term 'one' of cost <lambda> has shape \(\) in a batch"):
        PlanCosts(function, _NOW).of(_rollouts(), np.zeros(4, bool))
    assert PlanCosts(_Numbered(None), _NOW).of(_rollouts(), np.zeros(4, bool)) is not None


def test_an_error_is_explained_by_rows_only_if_one_simulation_does_not_raise_it() -> None:
    def failing(physics: Any) -> np.ndarray:
        if physics.num_envs is None:
            return np.zeros(())
        raise ValueError("the truth value is ambiguous")

    rollouts, diverged = _rollouts(), np.zeros(4, bool)
    alone: Any = SimpleNamespace(num_envs=None)
    one_row: Any = SimpleNamespace(num_envs=1)
    with pytest.raises(ValueError, match="cost failing raises ValueError in a batch of 12 rows"):
        PlanCosts(FunctionCost(failing), alone).of(rollouts, diverged)
    with pytest.raises(ValueError, match=r"^the truth value is ambiguous$"):
        PlanCosts(FunctionCost(failing), one_row).of(rollouts, diverged)
