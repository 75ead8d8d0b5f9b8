"""`Guide`: the path that the arm follows around a receptacle, and its progress.

guide = Guide()
guide.follow(find_path(now, goals, held, walls))
guide.advances(now), guide.is_astray(now)  # at each planning
plans = guide.plans(now, press, knots=5)
"""

import numpy as np

from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, plans_of

__all__ = ["FEW", "GOALS", "Guide"]

GOALS, FEW = 96, 12  # poses in which a path may end, and those of another attempt
_STRIDES = 2, 4, 7, 12, 18, 26  # points of the path from one knot to the next
_ASTRAY = 0.8  # radians; an arm so far off its path needs another
_IDLE = 30  # plannings; without headway for so long the arm needs another path
_HEADWAY = 0.1  # radians


class Guide:
    """A path, and the plannings until another one is searched.

    Attributes:
      path: the path; None while the arm follows none.
      patience: plannings until another path is searched.
    """

    def __init__(self) -> None:
        """Follows no path."""
        self.path: Path | None = None
        self.patience = 0
        self._least, self._idle = np.inf, 0  # radians left of the path, and plannings since

    def follow(self, path: Path | None) -> None:
        """Begins to follow a path, or none."""
        self.path, self._least, self._idle = path, np.inf, 0

    def drop(self, patience: int) -> None:
        """Leaves the path; the next search is after so many plannings."""
        self.path, self.patience = None, patience

    def left(self, now: np.ndarray) -> float:
        """Arc length from the arm's joints (4,) to the end, radians; infinite without a path."""
        return np.inf if self.path is None else float(self.path.remaining(now[None])[0])

    def advances(self, left: float) -> bool:
        """Whether the arc length to the end has recently decreased; called at each planning."""
        if left < self._least - _HEADWAY:
            self._least, self._idle = left, 0
        self._idle += 1
        return self._idle < _IDLE

    def is_astray(self, now: np.ndarray) -> bool:
        """Whether the arm's joints (4,) are too far off the path."""
        return self.path is not None and bool(self.path.astray(now[None])[0] > _ASTRAY)

    def plans(self, now: np.ndarray, grasp: float, knots: int) -> np.ndarray:
        """Targets along the path at several speeds with a grasp, (n, knots, 5); none without it."""
        if self.path is None:
            return np.zeros((0, knots, 5))
        ahead = [self.path.next_points(stride)[:knots] for stride in _STRIDES]
        return plans_of(now, [Proposal(points, [grasp]) for points in ahead], knots)
