"""The random streams of rows, and what is drawn from them besides the starts of episodes.

    streams = Streams(seed=0, count=256)
    streams.own[3]        # RandomState(3), from which row 3 draws its episodes
    streams.beside[3]     # the stream from which its model fields are drawn

A row's draws do not depend on the other rows.

    set_stream_fields(task, np.random.RandomState(7), physics.simulation)

An environment with seed 7, and each row of a batch that gets this seed, then has the fields that
`task.begin_stream` returns for `RandomState(7)`; its episodes are drawn from where that stopped.

    stagger = Stagger(num_envs=64)
    stagger.draw(3, stream)                 # for the first episode of a seed
    stagger.limit_of_next(3, limit=1000)    # such as 417; later 1000

Rows that begin together also end together, so that a learner sees one phase of the episode at a
time. The first episode of a row is truncated after a number of steps, uniform from 1 to the limit,
which is drawn from a separate stream. No draw of the task changes, and later episodes are full.
"""

import contextlib
import math
import weakref
from collections.abc import Mapping, Sequence

import numpy as np

from limberjack.rl.contract import Simulation, Task
from limberjack.rl.guards import first_seed
from limberjack.rl.randomize import stream_beside

__all__ = [
    "Stagger",
    "States",
    "Streams",
    "check_limit",
    "check_not_randomized",
    "set_forgotten_fields",
    "set_stream_fields",
    "stream_of",
]

# Tasks whose streams have begun, by id.
_have_fields: "weakref.WeakValueDictionary[int, Task]" = weakref.WeakValueDictionary()
_OWN = 1  # keeps the stream apart from the one of `randomize`
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
        self.shares[row] = stream_beside(stream, _OWN).uniform()

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


def set_stream_fields(
    task: Task, random: np.random.RandomState, simulation: Simulation, row: int | None = None
) -> bool:
    """Sets the fields that belong to a new stream, and returns whether there are any.

    Args:
      task: it need not define `begin_stream`.
      random: the stream, which is advanced.
      simulation: the simulation, or the batch.
      row: the row of the batch.

    Raises:
      ValueError: a field is not declared in the task's EPISODE_FIELDS; nothing is set.
    """
    fields = _fields(task, random)
    if fields:
        simulation.set_fields(fields, row)
    with contextlib.suppress(TypeError):  # of a class without weak references
        _have_fields[id(task)] = task
    return bool(fields)


def set_forgotten_fields(task: Task, simulation: Simulation) -> None:
    """Sets the fields of a new environment's stream, unless its factory has set them already."""
    begin = getattr(type(task), "begin_stream", None)
    if begin not in (None, Task.begin_stream) and _have_fields.get(id(task)) is not task:
        set_stream_fields(task, stream_of(task), simulation)


def check_not_randomized(task: Task, randomized: Sequence[str]) -> None:
    """Raises ValueError if `randomize` names a field that the task draws for each stream."""
    fields = _fields(task, np.random.RandomState(0))
    both = [name for name in randomized if name in fields]
    if both:
        raise ValueError(
            f"randomize names {', '.join(both)}, which task {type(task).__name__} draws itself for "
            "each seed; remove it from randomize"
        )


def _fields(task: Task, random: np.random.RandomState) -> Mapping[str, np.ndarray]:
    begin = getattr(task, "begin_stream", None)  # tasks need not be subclasses of `Task`
    fields = {} if begin is None else begin(random)
    declared = getattr(task, "EPISODE_FIELDS", ())
    undeclared = [name for name in fields if name not in declared]
    if undeclared:
        raise ValueError(
            f"begin_stream of task {type(task).__name__} sets {', '.join(undeclared)}; declare "
            f"EPISODE_FIELDS = {(*declared, *undeclared)}, so that each row has its own"
        )
    return fields


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
