"""`Stagger`: first episodes of the rows of a batch that end at different times.

    stagger = Stagger(num_envs=64)
    stagger.draw(3, stream)                 # for the first episode of a seed
    stagger.limit_of_next(3, limit=1000)    # such as 417; later 1000

Rows that begin together also end together, so that a learner sees one phase of the episode at a
time. The first episode of a row is truncated after a number of steps, uniform from 1 to the limit,
which is drawn from a separate stream. No draw of the task changes, and later episodes are full.
"""

import math

import numpy as np

__all__ = ["Stagger", "check_limit"]

_OWN = np.uint32(1)  # keeps the stream apart from the one of `randomize`
_FULL = 1.0  # share of the limit of an episode that is not cut short


class Stagger:
    """The length of each row's next episode, as a share of the limit.

    Attributes:
      shares: from 0 to 1, (num_envs,), of each row's next episode.
    """

    def __init__(self, num_envs: int) -> None:
        self.shares = np.full(num_envs, _FULL)

    def draw(self, row: int, stream: np.random.RandomState) -> None:
        """Draws the length of the first episode of a stream, which is not advanced."""
        _, key, position, *_ = stream.get_state(legacy=True)
        state = [*np.asarray(key, np.uint32).tolist(), int(position), int(_OWN)]
        self.shares[row] = np.random.RandomState(np.array(state, np.uint32)).uniform()

    def with_limits(self, limits: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """The limits and shares of rows as a snapshot holds them, (n, 2)."""
        return np.stack([limits[rows], self.shares[rows]], axis=-1)

    def limit_of_next(self, row: int, limit: float) -> float:
        """The limit of the episode that begins in a row; the one after it is full."""
        share, self.shares[row] = self.shares[row], _FULL
        return limit if share == _FULL else 1 + math.floor(share * math.ceil(limit))


def check_limit(limit: float) -> float:
    """The limit; raises ValueError if it is infinite: then nothing can be cut short at random."""
    if not math.isfinite(limit):
        raise ValueError(
            "stagger is True, but the episodes have no time limit: give the task a time_limit"
        )
    return limit
