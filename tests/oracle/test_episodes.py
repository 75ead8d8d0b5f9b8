"""Whole episodes of every task equal dm_control's in every bit."""

import itertools

import pytest

from tests.representatives import FEATURES

from . import twins

pytestmark = pytest.mark.oracle

_SEEDS = range(5)  # of tasks that stand for others
_FEWER_SEEDS = range(2)  # of the others, so that fifty-one tasks take minutes
_ALL_SEEDS = range(30)  # of every task, in the slow test
_EPISODE_STEPS = 1000  # every task's time limit is 1,000 control steps, if it has one
# One episode of zero actions of each seed saves a sixth of the time; the slow test plays two.
_EPISODES = {"random": 2, "bang-bang": 2, "zero": 1}


def _play(domain: str, task: str, actions: str, seed: int, episodes: int) -> None:
    """Whole episodes of one environment, one after the other."""
    env = twins.load(domain, task, seed)
    policy = env.actions(actions, seed)
    where = env.where
    for episode in range(episodes):
        env.where = f"{where}, {actions} actions, episode {episode}"
        env.reset()
        # An episode of a task without a time limit is left after as many steps.
        assert env.play(itertools.islice(policy, _EPISODE_STEPS)) == _EPISODE_STEPS, env.where
        assert env.ours.is_running == (env.ours.step_limit is None), env.where


@pytest.mark.parametrize("actions", twins.ACTIONS)
@pytest.mark.parametrize(("domain", "task"), twins.TASKS)
def test_every_time_step_of_whole_episodes_is_the_same(
    domain: str, task: str, actions: str
) -> None:
    for seed in _SEEDS if (domain, task) in FEATURES.values() else _FEWER_SEEDS:
        _play(domain, task, actions, seed, _EPISODES[actions])


@pytest.mark.slow
@pytest.mark.parametrize("actions", twins.ACTIONS)
@pytest.mark.parametrize(("domain", "task"), twins.TASKS)
def test_every_time_step_is_the_same_over_many_more_seeds(
    domain: str, task: str, actions: str
) -> None:
    for seed in _ALL_SEEDS:
        _play(domain, task, actions, seed, episodes=2)
