"""`limberjack.bench.take_turns`; the tests of benchmarks/ use `Contest`."""

from typing import Any

import numpy as np
import pytest

from limberjack import bench, suite
from limberjack.rl.control import Environment


def test_players_take_turns_with_the_same_actions() -> None:
    seen: list[tuple[str, np.ndarray]] = []

    def player(name: str) -> bench.Player:
        def play(actions: np.ndarray) -> float:
            seen.append((name, actions))
            return len(actions) * 0.5

        return play

    players = {name: player(name) for name in "abc"}
    shares: list[float] = []
    taken = bench.take_turns(
        players,
        lambda k: np.random.random((k, 512, 1)),
        0.0,
        min_rounds=2,
        warm_up_steps=5,
        on_round=shares.append,
    )
    assert shares == [0.0, 0.5]
    assert taken == {name: [0.5, 0.5] for name in "abc"}
    assert "".join(name for name, _ in seen) == "abcabcbca"
    for first in (0, 3, 6):
        assert all(actions is seen[first][1] for _, actions in seen[first : first + 3])


def _repeating(seed: int) -> Environment:
    return suite.load(
        "point_mass", "easy", {"random": seed, "time_limit": 1.0}, {"action_repeat": 2}
    )


def _late(seed: int) -> Environment:
    return suite.load("point_mass", "easy", {"random": seed}, {"faults": {"delay": {"actions": 2}}})


@pytest.mark.parametrize(("make", "episode"), [(_repeating, 25), (_late, 1000)])
def test_environments_that_repeat_or_delay_actions_are_compared(make: Any, episode: int) -> None:
    with bench.Contest(make, None, num_envs=2, num_threads=1) as contest:
        assert contest.episode == episode
        actions = contest.actions(5)
        for play in (contest.physics, contest.batch, contest.vector):
            play(actions)


def test_a_contest_of_different_steps_raises_and_closes_what_it_made() -> None:
    contest = bench.Contest("cartpole", "swingup", num_envs=2, num_threads=1)
    with pytest.raises(RuntimeError, match="different states"), contest:
        contest.batch(contest.actions(3))
    with pytest.raises(RuntimeError, match="closed"):
        contest.environment.reset()
