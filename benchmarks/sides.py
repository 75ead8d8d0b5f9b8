"""Two sides that step the same rows in turns, and must return the same rewards.

seconds = take_turns({"rows": step_rows, "vectorised": step_batch}, spec, seconds=30.0, rounds=20)
"""

import functools
from collections.abc import Callable, Mapping

import numpy as np
from dm_env import specs

from limberjack import bench
from limberjack.bench.contest import random_actions

__all__ = ["Step", "take_turns"]

# Takes the actions of all rows; returns their rewards.
Step = Callable[[np.ndarray], np.ndarray]


def take_turns(
    sides: Mapping[str, Step], spec: specs.BoundedArray, seconds: float, rounds: int
) -> dict[str, list[float]]:
    """Seconds per step of each side in each round; all take the same random actions.

    Args:
      sides: by name.
      spec: of the actions of all rows.
      seconds: approximate time of all rounds.
      rounds: the fewest.

    Raises:
      SystemExit: the rewards of the last step differ.
    """
    last: dict[str, np.ndarray] = {}

    def noted(name: str, actions: np.ndarray) -> None:
        last[name] = sides[name](actions)

    players = {name: bench.player(functools.partial(noted, name)) for name in sides}
    taken = bench.take_turns(players, functools.partial(random_actions, spec), seconds, rounds)
    (first, rewards), *others = last.items()
    for name, theirs in others:
        if not np.array_equal(rewards, theirs):
            raise SystemExit(f"the rewards of {name} and of {first} differ")
    return taken
