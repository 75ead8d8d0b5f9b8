"""`reward_and_terms`: rewards with and without terms."""

import collections
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.rl.reward_terms import reward_and_terms
from limberjack.suite import base

_PHYSICS: Any = None  # the tasks here read nothing


class _Product(base.Task):
    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict()

    def reward_terms(self, physics: Any) -> Any:
        return {"near": 0.5, "slow": 0.25}

    def reward_of(self, terms: Any) -> Any:
        return terms["near"] * terms["slow"]


class _Doubled(_Product):
    def get_reward(self, physics: Any) -> Any:
        return 2 * super().get_reward(physics)


def test_a_reward_made_of_terms_comes_with_them() -> None:
    assert reward_and_terms(_Product(), _PHYSICS) == (0.125, {"near": 0.5, "slow": 0.25})


def test_a_class_with_a_reward_of_its_own_has_no_terms() -> None:
    assert reward_and_terms(_Doubled(), _PHYSICS) == (0.25, {})


def test_a_task_whose_reward_was_replaced_has_no_terms() -> None:
    task: Any = _Product()
    task.get_reward = lambda physics: 7.0
    assert reward_and_terms(task, _PHYSICS) == (7.0, {})


def test_a_task_that_knows_no_terms_has_none() -> None:
    class Plain(control.Task):
        def initialize_episode(self, physics: Any) -> None: ...

        def before_step(self, action: Any, physics: Any) -> None: ...

        def action_spec(self, physics: Any) -> Any: ...

        def get_observation(self, physics: Any) -> Any: ...

        def get_reward(self, physics: Any) -> float:
            return 1.0

    assert reward_and_terms(Plain(), _PHYSICS) == (1.0, {})


@pytest.mark.parametrize("task", suite.ALL_TASKS, ids="-".join)
def test_the_suites_rewards_are_made_of_their_terms(task: tuple[str, str]) -> None:
    env = suite.load(*task, {"random": 0})
    env.reset()
    env.step(np.zeros(env.action_spec().shape))
    reward, terms = reward_and_terms(env.task, env.physics)
    has_own = type(env.task).get_reward is not base.Task.get_reward
    assert bool(terms) != has_own
    assert reward == env.task.get_reward(env.physics)


def test_underflow_never_raises_but_overflow_may() -> None:
    def rewarding(power: float) -> Any:
        task: Any = _Product()
        task.get_reward = lambda physics: np.exp(np.float64(power))
        return task

    with np.errstate(all="raise"):
        assert reward_and_terms(rewarding(-800.0), _PHYSICS) == (0.0, {})
        with pytest.raises(FloatingPointError, match="overflow"):
            reward_and_terms(rewarding(800.0), _PHYSICS)
