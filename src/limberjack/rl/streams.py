"""`Streams`: the random streams of a batch's rows.

    streams = Streams(seed=0, count=256)
    streams.own[3]        # RandomState(3), from which row 3 draws its episodes
    streams.beside[3]     # the stream from which its model fields are drawn

A row's draws do not depend on the other rows.
"""

from collections.abc import Iterable

import numpy as np

from limberjack.rl.contract import Simulation, Task
from limberjack.rl.guards import first_seed
from limberjack.rl.randomize import stream_beside
from limberjack.rl.stream_fields import set_stream_fields

__all__ = ["States", "Streams", "stream_of"]

# Results of `RandomState.get_state`: of the task's stream and of the one for model fields.
States = tuple[dict[str, object] | tuple[str, np.ndarray, int, int, float], ...]


def stream_of(task: Task) -> np.random.RandomState:
    """The stream from which a task draws its episodes.

    Raises:
      TypeError: it has none, since not all tasks are subclasses of `base.Task`.
    """
    stream = getattr(task, "random", getattr(task, "_random", None))
    if not isinstance(stream, np.random.RandomState):
        raise TypeError(
            f"task {type(task).__name__} has no numpy.random.RandomState `random`, which snapshots "
            "and randomize need: derive it from limberjack.suite.base.Task"
        )
    return stream


class Streams:
    """For each row a stream for its starts, and a separate stream for its model fields."""

    def __init__(self, seed: int | None, count: int) -> None:
        """Creates the streams of `RandomState(seed + i)`; see `first_seed`."""
        first = first_seed(seed, count)
        self.seeds: list[int | None] = list(range(first, first + count))  # None: not known
        self.own = [np.random.RandomState(first + i) for i in range(count)]
        self.beside = [stream_beside(stream) for stream in self.own]

    def replace(self, row: int, stream: np.random.RandomState, seed: int | None = None) -> None:
        """Replaces a row's streams; `seed` is the new stream's, if known."""
        self.seeds[row] = seed
        self.own[row] = stream
        self.beside[row] = stream_beside(stream)

    def begin(self, rows: Iterable[int], task: Task, simulation: Simulation) -> None:
        """Draws and sets the model fields that belong to the new streams of rows.

        Raises:
          ValueError: see `set_stream_fields`.
        """
        for row in rows:
            if set_stream_fields(task, self.own[row], simulation, row):
                self.beside[row] = stream_beside(self.own[row])

    def save(self, rows: np.ndarray, with_beside: bool) -> list[States]:
        """States of rows' streams: of `own`, or of `own` and `beside`."""
        kinds = (self.own, self.beside) if with_beside else (self.own,)
        return [tuple(kind[row].get_state() for kind in kinds) for row in rows]

    def load(self, rows: np.ndarray, saved: list[States]) -> None:
        """Restores rows' streams from the result of `save`."""
        for row, states in zip(rows, saved, strict=True):
            self.seeds[row] = None
            for kind, state in zip((self.own, self.beside), states, strict=False):
                kind[row].set_state(state)
