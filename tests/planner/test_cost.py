"""Costs as weighted sums of named terms."""

from typing import Any, ClassVar

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import Cost, Planner, Settings
from limberjack.rl.control import Environment

_SMALL = Settings(samples=4, horizon=0.1, knots=2, timestep=0.0125)


class _Crouch(Cost):
    settings = _SMALL
    weights: ClassVar = {"height": 2.0}

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        return {"height": physics.head_height(), "one": np.ones(np.shape(physics.head_height()))}


class _Alone(Cost):
    settings = _SMALL

    def step_cost(self, physics: Any) -> np.ndarray:
        return physics.head_height()


def _env() -> Environment:
    env = suite.load("humanoid", "stand", {"random": 3})
    env.reset()
    return env


def test_a_cost_is_the_weighted_sum_of_its_terms_and_others_weigh_one() -> None:
    env = _env()
    cost, height = _Crouch(env.task), env.physics.head_height()
    assert cost.weighted_terms(env.physics) == {"height": 2.0 * height, "one": 1.0}
    assert cost.step_cost(env.physics) == 2.0 * height + 1.0


def test_a_cost_without_terms_says_what_to_define() -> None:
    with pytest.raises(NotImplementedError, match=r"Cost defines neither terms.* nor step_cost"):
        Cost(None).step_cost(None)


def test_the_planner_explains_its_last_plan_by_the_terms_of_its_cost() -> None:
    env = _env()
    planner = Planner(env, num_threads=1, cost=_Crouch(env.task))
    with pytest.raises(RuntimeError, match=r"call planner\.act"):
        planner.explain()
    action = planner.act()
    stage, terms = planner.explain()
    assert stage == ""
    assert terms["one"] == 1.0
    # A body that falls for a tenth of a second: its head is near where it was.
    assert terms["height"] == pytest.approx(2.0 * float(env.physics.head_height()), abs=0.3)
    np.testing.assert_array_equal(planner.act(), action)


def test_a_cost_that_is_one_sum_is_explained_as_one_term() -> None:
    env = _env()
    planner = Planner(env, num_threads=1, cost=_Alone(env.task))
    planner.act()
    assert list(planner.explain().terms) == ["cost"]


def test_the_stage_of_a_task_has_a_name() -> None:
    env = suite.load("stacker", "stack_2", {"random": 0})
    env.reset()
    planner = Planner(env, num_threads=1)
    planner.act()
    stage, terms = planner.explain()
    assert stage
    assert "reward" in terms
