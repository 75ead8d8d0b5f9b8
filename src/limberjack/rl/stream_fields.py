"""Model fields that belong to a random stream: what a task draws before the first episode.

    set_stream_fields(task, np.random.RandomState(7), physics.simulation)

An environment with seed 7, and each row of a batch that gets this seed, then has the fields that
`task.begin_stream` returns for `RandomState(7)`; its episodes are drawn from where that stopped.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from limberjack.rl.contract import Simulation, Task

__all__ = ["check_not_randomized", "set_stream_fields"]


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
    return bool(fields)


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
