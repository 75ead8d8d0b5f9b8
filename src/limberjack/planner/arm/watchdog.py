"""`Watchdog`: notices that an arm, or what it should move, has made no headway for long.

    watchdog = Watchdog(patience=20, headway=0.03)
    if watchdog.watch({"object": 0.3, "fingertip": 0.02}):  # metres; at each planning
        watchdog.begin()                                    # and try something else

Headway is a distance that has fallen clearly below its least so far. Without distances it counts
how long something lasts, and `begin` says that it does not.
"""

from collections.abc import Mapping

import numpy as np

__all__ = ["Watchdog"]


class Watchdog:
    """Counts plannings without headway; see the module's docstring."""

    def __init__(self, patience: float, headway: float = 0.0, share: float = 1.0) -> None:
        """Begins to wait.

        Args:
          patience: plannings without headway, after which the arm is stuck.
          headway: by how much a distance must fall below its least so far, to count.
          share: of its least so far, below which a distance must fall, to count.
        """
        self._patience, self._headway, self._share = patience, headway, share
        self._pursued: object = None
        self.begin()

    def begin(self, *names: str) -> None:
        """Begins to wait, as if these distances had not been seen before, or none of them."""
        if not names:
            self._least: dict[str, float] = {}
        for name in names:
            self._least.pop(name, None)
        self._waited = 0.0

    @property
    def is_stuck(self) -> bool:
        """Whether there has been no headway for longer than the patience."""
        return self._waited > self._patience

    def watch(
        self, left: Mapping[str, float] | None = None, pursued: object = None, part: float = 1.0
    ) -> bool:
        """Counts a planning; returns `is_stuck`.

        Args:
          left: the distances that remain, by name. The first one of a name is headway.
          pursued: what they lead to; a new pursuit has seen no distance yet.
          part: of a planning that counts.
        """
        if pursued != self._pursued:
            self._pursued = pursued
            self.begin()
        for name, distance in (left or {}).items():
            if distance < self._share * self._least.get(name, np.inf) - self._headway:
                self._least[name], self._waited = distance, 0.0
        self._waited += part
        return self.is_stuck
