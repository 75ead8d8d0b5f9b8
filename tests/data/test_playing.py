"""Episodes in batches, beside single environments."""

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.data.playing import Recorded, actions_of, play
from limberjack.data.recipe import Kept
from limberjack.mujoco.simulation import STATE
from limberjack.policies.batched import EachRow
from limberjack.rl.control import Environment
from limberjack.rollout import Step, run_episode
from tests.evaluation.evaluated import sinking

from .collected import ARM, PENDULUM, assert_equal


def _load(where: tuple[str, str, float], seed: int = 0) -> Environment:
    domain, task, seconds = where
    return suite.load(domain, task, {"random": seed, "time_limit": seconds})


@pytest.mark.parametrize("where", [PENDULUM, ARM, ("reacher", "easy", 0.06)])
def test_every_bit_is_that_of_a_single_environment(where: tuple[str, str, float]) -> None:
    episodes = play(_load(where), EachRow(policies.random), range(62, 66), Kept(states=True), 1)
    for episode in episodes:
        single, steps = _load(where, episode.seed), list[Step]()
        states, reached = list[np.ndarray](), list[bool]()

        def on_step(step: Step) -> None:
            steps.append(step)  # noqa: B023 (called in this turn)
            states.append(single.physics.get_state(STATE))  # noqa: B023
            if step.number:
                reached.append(bool(single.task.is_success(single.reward_terms)))  # noqa: B023

        run_episode(single, policies.random, episode.seed, on_step)
        for name, values in episode.observations.items():
            expected = np.array([step.time_step.observation[name] for step in steps])
            np.testing.assert_array_equal(values, expected)
        np.testing.assert_array_equal(episode.actions, [step.action for step in steps[1:]])
        np.testing.assert_array_equal(episode.rewards, [step.reward for step in steps[1:]])
        np.testing.assert_array_equal(episode.states, states)
        np.testing.assert_array_equal(episode.success, reached)
        assert episode.truncated.tolist() == [False] * (episode.length - 1) + [True]
        assert not episode.terminated.any()
        fields = single.snapshot().physics
        assert set(episode.fields) == set(single.task.EPISODE_FIELDS)
        for name, values in episode.fields.items():
            np.testing.assert_array_equal(values, fields[name][0])


def test_episodes_do_not_depend_on_those_beside_them() -> None:
    together = play(_load(ARM), EachRow(policies.random), range(5), Kept(states=True), 2)
    alone = play(_load(ARM), EachRow(policies.random), [3], Kept(states=True), 1)
    assert_equal(alone[0], together[3])


def test_an_episode_ends_where_its_task_or_its_simulation_ends_it() -> None:
    environment = sinking(0, some_diverge=True)
    episodes = play(environment, EachRow(policies.zero), range(40), Kept(), 1)
    diverged = [episode for episode in episodes if episode.diverged]
    sunk = [e for e in episodes if e.terminated[-1] and not e.diverged]
    assert diverged
    assert sunk
    assert len({episode.length for episode in sunk}) > 1
    for episode in episodes:
        assert (episode.terminated | episode.truncated).tolist()[-1]
        assert not (episode.terminated | episode.truncated)[:-1].any()
    assert all(episode.rewards[-1] == 0.0 for episode in diverged)


def test_recorded_actions_give_the_same_episodes() -> None:
    episodes = play(_load(ARM), EachRow(policies.random), range(3), Kept(states=True), 1)
    actor = Recorded({episode.seed: episode.actions for episode in episodes})
    for one, other in zip(
        episodes, play(_load(ARM), actor, range(3), Kept(states=True), 1), strict=True
    ):
        assert_equal(one, other)


def test_a_policy_that_plays_alone_gives_its_actions() -> None:
    steps: list[int] = []
    actions = actions_of(_load(PENDULUM), policies.random, 5, steps.append)
    (expected,) = play(_load(PENDULUM), EachRow(policies.random), [5], Kept(), 1)
    np.testing.assert_array_equal(actions, expected.actions)
    assert steps == [1] * 10


def test_the_steps_of_all_running_rows_are_reported() -> None:
    steps: list[int] = []
    play(_load(PENDULUM), EachRow(policies.zero), range(4), Kept(), 1, steps.append)
    assert steps == [4] * 10
