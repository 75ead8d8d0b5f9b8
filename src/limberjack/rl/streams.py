"""`Streams`: the random streams of a batch's rows.

    streams = Streams(seed=0, count=256)
    streams.own[3]        # the stream of RandomState(3), that row 3 draws its episodes from
    streams.beside[3]     # the one that the fields of its model are drawn from

A row's draws do not depend on the other rows.
"""

from typing import Any

import numpy as np

from limberjack.rl.randomize import stream_beside
from limberjack.utils.seeds import checked_seed

__all__ = ["States", "Streams"]

# Any: what `RandomState.get_state` gives, of the task's stream and of one beside it.
States = tuple[Any, ...]


class Streams:
    """For each row the stream of its starts, and one beside it for the fields of its model."""

    def __init__(self, seed: int | None, count: int) -> None:
        """Makes those of `RandomState(seed + i)`; None for any seed.

        Raises:
          TypeError, ValueError: the first or the last seed is none: see `checked_seed`.
        """
        first = np.random.RandomState().randint(2**31) if seed is None else checked_seed(seed)
        checked_seed(first + count - 1)
        self.seeds: list[int | None] = list(range(first, first + count))  # None: not known
        self.own = [np.random.RandomState(first + i) for i in range(count)]
        self.beside = [stream_beside(stream) for stream in self.own]

    def replace(self, row: int, stream: np.random.RandomState, seed: int | None = None) -> None:
        """Gives a row another stream, which was made with the seed."""
        self.seeds[row] = seed
        self.own[row] = stream
        self.beside[row] = stream_beside(stream)

    def save(self, rows: np.ndarray, with_beside: bool) -> list[States]:
        """The states of rows' streams, of the first kind or of both."""
        kinds = (self.own, self.beside) if with_beside else (self.own,)
        return [tuple(kind[row].get_state() for kind in kinds) for row in rows]

    def load(self, rows: np.ndarray, saved: list[States]) -> None:
        """Lets rows' streams go on from what was saved."""
        for row, states in zip(rows, saved, strict=True):
            self.seeds[row] = None
            for kind, state in zip((self.own, self.beside), states, strict=False):
                kind[row].set_state(state)
