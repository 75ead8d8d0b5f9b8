"""Episodes with a policy."""

import numpy as np
import pytest

from limberjack import policies, rollout, suite
from limberjack.rl.control import Environment
from tests.representatives import PAIRS


def _load(domain: str, task: str, seed: int, time_limit: float = 0.5) -> Environment:
    return suite.load(domain, task, task_kwargs={"random": seed, "time_limit": time_limit})


@pytest.mark.parametrize(("domain", "task"), PAIRS)
def test_an_episode_has_the_rewards_of_a_plain_loop(domain: str, task: str) -> None:
    episode = rollout.run_episode(_load(domain, task, 3), policies.random, 3)

    environment = _load(domain, task, 3)
    act = policies.random(environment.action_spec(), 3)
    time_step = environment.reset()
    rewards = []
    total = 0.0
    while not time_step.last():
        time_step = environment.step(act(time_step.observation))
        rewards.append(time_step.reward)
        total += time_step.reward
    np.testing.assert_array_equal(episode.rewards, rewards)
    assert episode.total == total
    assert episode.length == len(rewards) == environment.step_limit


@pytest.mark.parametrize(("domain", "task"), PAIRS)
def test_an_episode_can_be_run_again_alone(domain: str, task: str) -> None:
    first = rollout.run_episode(_load(domain, task, 9, 0.1), policies.random, 9)
    rollout.run_episode(_load(domain, task, 10, 0.1), policies.random, 10)
    again = rollout.run_episode(_load(domain, task, 9, 0.1), policies.random, 9)
    np.testing.assert_array_equal(first.rewards, again.rewards)
    assert first.start == again.start


def test_the_kind_of_start_is_kept_where_there_are_kinds() -> None:
    def start(domain: str, task: str, seed: int) -> str | None:
        return rollout.run_episode(_load(domain, task, seed, 0.1), policies.zero, seed).start

    starts = {start("manipulator", "bring_ball", seed) for seed in range(40)}
    # One kind in ten is rare: another choice of 40 seeds could miss it, these do not.
    assert starts == {"in_hand", "in_target", "uniform"}
    starts = {start("humanoid", "stand", seed) for seed in range(10)}
    assert starts == {"face_up", "face_down", "on_side"}


def test_the_reset_and_every_step_are_reported_as_they_were_returned() -> None:
    seen: list[rollout.Step] = []
    episode = rollout.run_episode(_load("humanoid", "stand", 0), policies.random, 0, seen.append)
    assert [step.number for step in seen] == list(range(episode.length + 1))
    assert (seen[0].action, seen[0].reward, seen[0].total) == (None, 0.0, 0.0)
    assert [step.time_step.first() for step in seen] == [True] + [False] * episode.length
    np.testing.assert_array_equal([step.total for step in seen[1:]], episode.returns)
    np.testing.assert_array_equal([step.reward for step in seen[1:]], episode.rewards)
    environment = _load("humanoid", "stand", 0)
    environment.reset()
    for step in seen[1:]:
        assert environment.step(step.action).reward == step.reward


def test_an_episode_can_be_cut_short() -> None:
    whole = rollout.run_episode(_load("humanoid", "stand", 0), policies.random, 0)
    part = rollout.run_episode(_load("humanoid", "stand", 0), policies.random, 0, max_steps=7)
    np.testing.assert_array_equal(part.rewards, whole.rewards[:7])


@pytest.mark.parametrize("seed", [True, 1.5, -1])
def test_an_invalid_seed_is_refused_before_anything_moves(seed: object) -> None:
    environment = _load("humanoid", "stand", 0)
    with pytest.raises((TypeError, ValueError), match="seed is"):
        rollout.run_episode(environment, policies.random, seed)  # pyright: ignore[reportArgumentType]
    assert not environment.is_running


def test_an_endless_environment_has_no_step_limit() -> None:
    assert _load("humanoid", "stand", 0, float("inf")).step_limit is None
