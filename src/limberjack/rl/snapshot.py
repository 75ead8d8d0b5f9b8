"""`Snapshot`: all that the future of an environment depends on.

    snapshot = env.snapshot()          # a single environment, or a batch
    env.restore(snapshot)              # its future is the same, bit for bit
    batch.restore(row, rows=[3])       # one row into any row

It holds the integration state with the solver's warm start, the model fields that an episode's
start sets, step counters, pending resets, random streams and the pictures observed last. It is a
plain object that pickles; it restores in another process and into a batch with another number of
threads. It does not hold the task's settings or the model, which must be the same.
"""

import dataclasses
import math
from typing import Any

import numpy as np

__all__ = ["Snapshot"]


@dataclasses.dataclass(frozen=True)
class Snapshot:
    """State of n environments of one task.

    Attributes:
      origin: task, model and version that it is of, which must agree at restoring.
      physics: the physics' arrays by name, (n, ...) each.
      step_count: steps since each episode began, (n,).
      begins: whether each one's next step begins an episode, (n,).
      streams: states of each one's `RandomState`s: the task's, and the randomisation's if any.
      frames: what was observed in pictures, by name, (n, ...) each; nothing without pixels.
      registration: the suite's record of the domain, whose module is imported where this is
        unpickled.
    """

    origin: dict[str, Any]
    physics: dict[str, np.ndarray]
    step_count: np.ndarray
    begins: np.ndarray
    streams: list[Any]
    frames: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    registration: object = None

    def __len__(self) -> int:
        return len(self.streams)

    def check(self, origin: dict[str, Any], size: int, step_limit: float) -> None:
        """Raises ValueError if this is of another task, model or version, or not of `size`.

        Also if an episode that goes on has as many steps as `step_limit` or more.
        """
        for what, expected in origin.items():
            found = self.origin.get(what)
            if found != expected:
                raise ValueError(
                    f"the snapshot is of {what} {found!r}; expected {expected!r}, that of this "
                    "environment"
                )
        if len(self) != size:
            raise ValueError(
                f"the snapshot holds {len(self)} environments; expected {size}: restore into as "
                "many rows"
            )
        running = self.step_count[~self.begins]
        if (running >= step_limit).any():
            raise ValueError(
                f"the snapshot is of step {running.max()} of an episode, and episodes end after "
                f"{math.ceil(step_limit)} steps here: restore it where the time limit is longer"
            )
