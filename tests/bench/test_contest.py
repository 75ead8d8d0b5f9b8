"""`limberjack.bench.take_turns`; the tests of benchmarks/ use `Contest`."""

import numpy as np

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
