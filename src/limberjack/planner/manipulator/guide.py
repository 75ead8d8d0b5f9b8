"""`Guide`: the path that the arm follows around a receptacle, and its progress.

guide = Guide()
guide.follow(find_path(now, goals, held, walls))
guide.advances(now), guide.is_astray(now)  # at each planning
plans = guide.plans(now, press, knots=5)
"""

import dataclasses

import numpy as np

from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, plans_of

__all__ = ["GOALS", "Guide", "few_of"]

GOALS = 96  # poses in which a path may end


def few_of(random: np.random.Generator, poses: np.ndarray) -> np.ndarray:
    """Twelve of the poses (n, 4), for another attempt."""
    return poses[random.permutation(len(poses))[:12]]


@dataclasses.dataclass
class Guide:
    """A path, and the plannings until another one is searched."""

    path: Path | None = None
    patience: int = 0  # plannings until another path is searched
    _least: float = np.inf  # radians left of the path
    _idle: int = 0  # plannings since

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
        """Whether the arc length to the end has decreased by 0.1 radians in the last 30 plannings.

        Called at each planning.
        """
        if left < self._least - 0.1:
            self._least, self._idle = left, 0
        self._idle += 1
        return self._idle < 30

    def is_astray(self, now: np.ndarray) -> bool:
        """Whether the arm's joints (4,) are more than 0.8 radians off the path."""
        return self.path is not None and bool(self.path.astray(now[None])[0] > 0.8)

    def plans(self, now: np.ndarray, grasp: float, knots: int) -> np.ndarray:
        """Targets along the path at several speeds with a grasp, (n, knots, 5); none without it."""
        if self.path is None:
            return np.zeros((0, knots, 5))
        strides = 2, 4, 7, 12, 18, 26  # points of the path from one knot to the next
        ahead = [self.path.next_points(stride)[:knots] for stride in strides]
        return plans_of(now, [Proposal(points, [grasp]) for points in ahead], knots)
