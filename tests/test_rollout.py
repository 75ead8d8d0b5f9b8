"""Episodes with a policy."""

import numpy as np
import pytest

from limberjack import policies, rollout, suite
from tests.representatives import PAIRS


def _load(domain: str, task: str, seed: int, time_limit: float = 0.5) -> suite.control.Environment:
    return suite.load(domain, task, task_kwargs={"random": seed, "time_limit": time_limit})


@pytest.mark.parametrize(("domain", "task"), PAIRS)
def test_an_episode_is_what_a_plain_loop_gives(domain: str, task: str) -> None:
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
    assert start("humanoid", "stand", 0) is None


def test_every_step_is_reported_with_the_return_so_far() -> None:
    seen: list[tuple[int, float]] = []
    episode = rollout.run_episode(
        _load("humanoid", "stand", 0), policies.random, 0, lambda *step: seen.append(step)
    )
    assert seen[0] == (0, 0.0)
    assert [steps for steps, _ in seen] == list(range(episode.length + 1))
    np.testing.assert_array_equal([total for _, total in seen[1:]], episode.returns)


def test_an_endless_environment_has_no_step_limit() -> None:
    assert _load("humanoid", "stand", 0, float("inf")).step_limit is None
