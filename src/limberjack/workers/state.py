"""`State`: the number of workers that play, start and were lost, for a progress bar."""

import dataclasses
from collections.abc import Callable

__all__ = ["OnState", "State"]


@dataclasses.dataclass(frozen=True)
class State:
    """Workers at one moment."""

    workers: int  # processes, or units at a time in an executor or in Ray
    playing: int
    starting: int = 0
    lost: int = 0  # since the start; each was replaced
    note: str = ""  # an event to report on a line of its own, such as a lost node

    def __str__(self) -> str:
        parts = [f"{self.playing} of {self.workers} workers playing"]
        if self.starting:
            parts.append(f"{self.starting} starting")
        if self.lost:
            parts.append(f"{self.lost} lost")
        return ", ".join(parts)


OnState = Callable[[State], object]
