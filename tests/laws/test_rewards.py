"""Rewards and their terms lie between 0 and 1, costs aside, and rewards follow from the terms."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.reward_terms import reward_and_terms
from tests.suite import expectations

from .episodes import TASKS, Task, actions, load, play


@pytest.mark.parametrize("task", TASKS)
def test_rewards_and_terms_are_floats_between_0_and_1(task: Task) -> None:
    env = load(task)
    for _ in range(10):
        env.reset()
        for action in actions(env, 10):
            reward = env.step(action).reward
            assert isinstance(reward, float)
            is_bounded = task not in expectations.UNBOUNDED
            assert reward >= 0.0 or not is_bounded
            assert reward <= 1.0
            terms = env.reward_terms
            assert set(env.task.GOAL) <= set(terms)
            for name, term in terms.items():
                assert isinstance(term, float), name
                assert term >= 0.0, name
                assert term <= 1.0 or not is_bounded, name


@pytest.mark.parametrize("task", TASKS)
def test_the_reward_follows_from_its_terms(task: Task) -> None:
    env = load(task)
    set_state = expectations.REWARDING.get(task[0], expectations.any_start)
    combine: Any = expectations.COMBINED.get(task, env.task.reward_of)
    largest = 0.0
    for _ in range(30):
        set_state(env)
        reward, terms = reward_and_terms(env.task, env.physics)
        assert reward == env.task.get_reward(env.physics)
        largest = max(largest, reward)
        if terms:  # else the task overrides get_reward
            assert reward == env.task.reward_of(terms)
            # The factors are multiplied in another order.
            assert reward == pytest.approx(combine(terms))
    assert largest > 1e-3, "the law was never put to the test"


@pytest.mark.parametrize("task", TASKS)
def test_showing_the_reward_colours_materials_and_changes_nothing_else(task: Task) -> None:
    plain = load(task)
    shown = suite.load(*task, {"random": 0}, visualize_reward=True)
    assert play(shown, 20) == play(plain, 20)
    colours = shown.physics.named.model.mat_rgba
    reward = 0.6
    shown.task.get_reward = lambda physics: reward
    shown.step(np.zeros(shown.action_spec().shape))
    for name in ("self", "effector", "target"):
        default, highlight = colours[f"{name}_default"], colours[f"{name}_highlight"]
        expected = reward**4 * highlight + (1 - reward**4) * default
        # The blend may be rounded in another order.
        np.testing.assert_allclose(colours[name], expected, rtol=1e-6)
        assert not np.array_equal(default, highlight)
    np.testing.assert_array_equal(
        plain.physics.named.model.mat_rgba["self"], colours["self_default"]
    )
