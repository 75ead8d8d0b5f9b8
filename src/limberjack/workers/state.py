"""Reports on running work, for progress bars: `State` counts workers, `OnProgress` episodes."""

import dataclasses
from collections.abc import Callable

__all__ = ["OnProgress", "OnState", "State", "counted_from"]

# Called with the name of what is played, such as the policy, the number of finished episodes, and
# how many episodes' worth of steps the running ones have played.
OnProgress = Callable[[str, int, float], object]


def counted_from(before: int, on_progress: OnProgress | None) -> OnProgress:
    """Reports the progress of a part of the work, which begins after so many episodes.

    Args:
      before: episodes that have finished.
      on_progress: called with those of the part too; None for nothing.
    """

    def show(what: str, finished: int, part: float = 0.0) -> None:
        if on_progress is not None:
            on_progress(what, before + finished, part)

    return show


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
