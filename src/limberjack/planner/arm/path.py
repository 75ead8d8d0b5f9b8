"""`Path`: straight joint paths from waypoint to waypoint, measured by arc length.

    path = Path(waypoints, joint_time)  # (n, 4)
    path.remaining(joints)              # (N, 4) -> (N,), radians to the end
    path.ahead(0.3, count=4)            # joints 0.3, 0.6, ... radians along the path, (4, 4)
    path.advance(now)                   # at each planning of an arm that follows it
    path.left, path.is_stalled, path.is_astray

The remaining length is that from a point of the path, plus 1.3 times the distance to it: a way
beside the path counts for more than one along it. Points beyond a bend cost more to go to directly:
there is a reason for the bend. Searches return paths, and costs charge their remaining length.
"""

import functools
from collections.abc import Callable

import numpy as np

from limberjack.planner.arm.watchdog import Watchdog

__all__ = ["Path", "Sight", "joint_sum", "joint_time"]

# From a point's number to that of the last point to which the arm can go straight from there; if it
# is not known, these are the points up to the first bend.
Sight = Callable[[int], int]


_TIMES = np.array([0.67, 0.75, 1.0, 1.0])  # of a radian of each joint at full speed, to the wrist's
_ASTRAY = 0.8  # radians; an arm so far off its path needs another one
_HEADWAY, _PATIENCE = 0.1, 29  # radians that count as headway; plannings without it


class Path:
    """Waypoints, and the arc length along them, `length`, radians.

    Attributes:
      left: remaining length for the arm when it last advanced, radians.
      is_straight: whether the path leads straight to its end.
      is_astray: whether the arm is far off the path.
    """

    def __init__(
        self,
        waypoints: np.ndarray,  # joints at which the path bends, and its ends, (n, 4)
        distance: Callable[[np.ndarray, np.ndarray], np.ndarray],  # `joint_sum` or `joint_time`
        goal: np.ndarray | None = None,  # waypoints that belong to the goal; by default the last
        via: np.ndarray | None = None,  # the waypoint before, if a search has put one there, (4,)
        view: int | None = None,  # number of points that `remaining` searches; all by default
        sights: "Callable[[np.ndarray], Sight] | None" = None,  # of points (n, 4)
    ) -> None:
        self.waypoints, self.via = waypoints, via
        self.goal = waypoints[-1:] if goal is None else goal
        self.is_straight = len(waypoints) == 2
        self._distance, self._view = distance, view
        lengths = distance(waypoints[:-1], waypoints[1:])
        self._ends = np.concatenate([[0.0], lengths.cumsum()])
        self.length = self.left = float(self._ends[-1])
        self.is_astray = False
        self._covered = 0  # points
        self._sight = None if sights is None else sights(self.points)
        self._watchdog = Watchdog(_PATIENCE, _HEADWAY)

    @functools.cached_property
    def _places(self) -> np.ndarray:
        """Arc lengths of the points, (n,), at most 0.1 radians apart."""
        return np.linspace(0.0, self.length, 2 + int(self.length / 0.1))

    @functools.cached_property
    def points(self) -> np.ndarray:
        """Joints along the path, equally spaced, (n, 4)."""
        return self._at(self._places)

    def _at(self, places: np.ndarray) -> np.ndarray:
        """Joints at arc lengths, (n,) -> (n, 4)."""
        return np.stack([np.interp(places, self._ends, j) for j in self.waypoints.T], axis=-1)

    def advance(self, now: np.ndarray) -> None:
        """Covers the points before the one nearest to the arm's joints, (4,); measures headway."""
        self._covered += int(self._aside(now[None])[0].argmin())
        self.left = float(self.remaining(now[None])[0])
        self.is_astray = bool(self._aside(now[None]).min() > _ASTRAY)
        self._watchdog.watch({"left": self.left})

    @property
    def is_stalled(self) -> bool:
        """Whether the arm makes no headway."""
        return self._watchdog.is_stuck

    def remaining(self, joints: np.ndarray) -> np.ndarray:
        """Remaining length from joints to the end, by the best point, (N, 4) -> (N,), radians."""
        aside = self._aside(joints)
        places = self._places[self._window]
        if self._sight is None:
            is_behind = places > self._ends[1]
        else:
            is_behind = np.arange(len(places)) > self._sight(self._covered) - self._covered
        # Going straight to points out of sight costs more beyond 0.35 radians.
        cut = is_behind * np.maximum(aside - 0.35, 0.0)
        return (1.3 * aside + 5.0 * cut + (self.length - places)).min(axis=-1)

    def ahead(self, stride: float, count: int) -> np.ndarray:
        """Joints at multiples of an arc length from the beginning, (count, 4)."""
        return self._at(stride * np.arange(1, count + 1))

    def next_points(self, stride: int) -> list[np.ndarray]:
        """One in `stride` of the points that are not covered yet, and the last point."""
        return [*self.points[self._covered + stride :: stride], self.points[-1]]

    @property
    def _window(self) -> slice:
        # Not all points: the end may be near, but behind an obstacle.
        return slice(self._covered, None if self._view is None else self._covered + self._view)

    def _aside(self, joints: np.ndarray) -> np.ndarray:
        """Distances of joints (N, 4) from the next points, (N, points)."""
        return self._distance(joints[:, None], self.points[self._window])


def joint_sum(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The angle by which all joints turn together, (..., 4) -> (...), radians."""
    turns = np.abs(end[..., 0] - start[..., 0])
    for joint in range(1, 4):  # quicker than a sum over so short an axis
        turns = turns + np.abs(end[..., joint] - start[..., joint])
    return turns


def joint_time(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The time of the slowest joint, (..., 4) -> (...), as radians of the wrist."""
    turns = _TIMES * np.abs(end - start)
    # Quicker than `max` over so short an axis.
    first, last = np.maximum(turns[..., 0], turns[..., 1]), np.maximum(turns[..., 2], turns[..., 3])
    return np.maximum(first, last)
