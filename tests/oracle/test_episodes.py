"""Whole episodes of every task equal dm_control's in every bit."""

import pytest

from . import twins

pytestmark = pytest.mark.oracle

_SEEDS = range(5)
_MORE_SEEDS = range(5, 30)
_EPISODES = 2
_EPISODE_STEPS = 1000  # every task's time limit is 1,000 control steps


def _play_episodes(domain: str, task: str, actions: str, seed: int) -> None:
    env = twins.load(domain, task, seed)
    policy = env.actions(actions, seed)
    where = env.where
    for episode in range(_EPISODES):
        env.where = f"{where}, {actions} actions, episode {episode}"
        env.reset()
        assert env.play(policy) == _EPISODE_STEPS, env.where


@pytest.mark.parametrize("actions", twins.ACTIONS)
@pytest.mark.parametrize(("domain", "task"), twins.TASKS)
def test_every_time_step_of_whole_episodes_is_the_same(
    domain: str, task: str, actions: str
) -> None:
    for seed in _SEEDS:
        _play_episodes(domain, task, actions, seed)


@pytest.mark.slow
@pytest.mark.parametrize("actions", twins.ACTIONS)
@pytest.mark.parametrize(("domain", "task"), twins.TASKS)
def test_every_time_step_is_the_same_over_many_more_seeds(
    domain: str, task: str, actions: str
) -> None:
    for seed in _MORE_SEEDS:
        _play_episodes(domain, task, actions, seed)
