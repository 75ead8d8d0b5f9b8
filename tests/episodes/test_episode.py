"""The arrays of an episode."""

from .collected import PENDULUM, made


def test_the_return_and_the_length_are_those_of_the_rewards() -> None:
    _, (episode,) = made(PENDULUM, range(3, 4))
    assert episode.length == 10 == len(episode.actions)
    total = 0.0
    for reward in episode.rewards.tolist():
        total += reward
    assert episode.total == total
