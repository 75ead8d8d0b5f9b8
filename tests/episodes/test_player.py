"""Episodes of a policy in a task, in this process and as workers play them."""

import contextlib
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.player import Player, play_unit
from limberjack.episodes.playing import Step
from limberjack.suite.base import kind_of_start
from limberjack.workers import Scale, prepare
from tests import plain_domain
from tests.rollouts import run_episode

from .collected import ARM, PENDULUM, assert_equal

_SEEDS = [3, 62, 63, 64]


def _played(where: tuple[str, str, float], kept: Kept | None = None, **how: Any) -> list[Episode]:
    domain, task, seconds = where
    scale = Scale(num_threads=1)
    player = Player(domain, task, "random", _SEEDS, time_limit=seconds, scale=scale)
    with contextlib.closing(player):
        ((seeds, episodes),) = player.results([_SEEDS], list, kept, **how)
    assert seeds == _SEEDS
    return episodes


def test_episodes_have_the_kinds_of_their_starts() -> None:
    for episode in _played(ARM):
        environment = suite.load(*ARM[:2], {"random": episode.seed})
        environment.reset()
        assert episode.start == kind_of_start(environment)
    assert {episode.start for episode in _played(PENDULUM)} == {None}


def test_each_episode_is_reported_as_it_ends_after_its_steps() -> None:
    events: list[str] = []

    def on_step(step: Step) -> None:
        if step.actions is None:
            events.append("begins")

    ended: list[int] = []
    played = _played(PENDULUM, on_step=on_step, on_ended=lambda one: ended.append(one.seed))
    assert events
    assert ended == [episode.seed for episode in played]
    assert sorted(ended) == _SEEDS


@pytest.mark.parametrize("vectorised", [True, False])
def test_both_kinds_of_batches_and_a_worker_play_the_same(vectorised: bool) -> None:
    kept = Kept(states=True)
    setup = prepare(*ARM[:2], "random", time_limit=ARM[2], num_threads=1, vectorised=vectorised)
    here, there = (
        sorted(played, key=lambda episode: episode.seed)
        for played in (_played(ARM, kept), play_unit(setup, _SEEDS, kept))
    )
    for one, other in zip(here, there, strict=True):
        assert_equal(one, other)


def test_a_worker_repeats_actions_as_it_was_told() -> None:
    setup = prepare(plain_domain.make, None, "random", action_repeat=3, num_threads=1)
    (episode,) = play_unit(setup, [4], Kept())
    changes = np.flatnonzero((np.diff(episode.actions, axis=0) != 0).any(axis=1)) + 1
    assert changes.tolist() == list(range(3, 25, 3))


def test_without_anything_kept_an_episode_has_its_rewards() -> None:
    setup = prepare(plain_domain.make, None, "random", num_threads=1)
    (episode,) = play_unit(setup, [4])
    single = run_episode(plain_domain.make(4), policies.find("random"), 4)
    np.testing.assert_array_equal(episode.rewards, single.rewards)
    assert not episode.observations
