"""`limberjack.bench`: turns, ratios and the recommended number of threads."""

from typing import Any

import numpy as np
import pytest

from limberjack import bench


def test_players_take_turns_with_the_same_actions() -> None:
    seen: list[tuple[str, np.ndarray]] = []

    def player(name: str) -> bench.Player:
        def play(actions: np.ndarray) -> float:
            seen.append((name, actions))
            return len(actions) * 0.5

        return play

    players = {name: player(name) for name in "abc"}
    taken = bench.take_turns(
        players, lambda k: np.random.random((k, 512, 1)), 0.0, min_rounds=2, warm_up_steps=5
    )
    assert taken == {name: [0.5, 0.5] for name in "abc"}
    assert "".join(name for name, _ in seen) == "abcabcbca"
    for first in (0, 3, 6):
        assert all(actions is seen[first][1] for _, actions in seen[first : first + 3])


def test_measure_compares_and_sweeps_threads() -> None:
    reported: list[tuple[str, float]] = []
    result = bench.measure(
        "stacker",
        "stack_2",
        num_envs=4,
        num_threads=3,
        seconds=0.01,
        on_progress=lambda what, share: reported.append((what, share)),
    )
    shares = [share for _, share in reported]
    assert shares == sorted(shares)
    assert reported[0] == ("preparing", 0.0)
    assert reported[-1][0] == "comparing numbers of threads"
    assert 0.5 < shares[-1] <= 1.0
    assert [speed.what for speed in result.speeds] == ["physics", "batch", "vector"]
    assert [speed.num_threads for speed in result.speeds] == [3, 3, 3]
    assert [speed.num_threads for speed in result.sweep] == [1, 2, 3]
    assert all(speed.steps_per_second > 0 for speed in (*result.speeds, *result.sweep))
    assert result.speeds[0].ratio == result.sweep[0].ratio == 1
    assert result.recommended_threads in (1, 2, 3)


@pytest.mark.parametrize(
    ("name", "value"), [("num_envs", 0), ("num_threads", 0), ("seconds", 0.0), ("task", "stak_2")]
)
def test_arguments_that_cannot_be_measured_are_refused(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"{name} is {value}|did you mean|Did you mean"):
        bench.measure(**{"domain": "stacker", "task": "stack_2", name: value})
