"""Routes of the planar arm that keep clear of floor and walls.

    found = routes(random, now=qpos[:4], goals=poses[:, None], reach=0.178)  # shortest first

A route is a straight joint path to one of the goals, or two by way of a stop that is drawn. It
knows nothing of objects on the way.
"""

import functools
from collections.abc import Sequence

import numpy as np

from limberjack.planner.planar_ik import hand_gap, hand_height, is_clear

__all__ = ["Route", "kept", "routes"]

_STOPS = 80  # that are drawn
_POINTS = np.arange(1, 7) / 6  # of a straight path, where it is looked at
_ENDS = 24  # that are tried at least, of goals with the root a turn further or less
_AT_ONCE = 96  # paths that are looked at together
_TIMES = np.array([0.67, 0.75, 1.0, 1.0])  # of a radian of each joint at most speed, to the wrist's
_SPACING = 0.1  # radians; between the points of a route that are compared with
_RETURN = 1.3  # how much a radian beside a route counts, against one along it
# Radians beside the route from which on what is behind a bend is not gone to straight, and how much
# one more counts: there is a reason for the bend.
_CORNER, _CUT = 0.35, 5.0
_KEPT = 0.012  # metres; how far a hand's middle lines keep from floor and walls
_GAP = 0.025  # metres; between that and what the hand goes around


class Route:
    """Where to go next, and then.

    Attributes:
      stations: joints to pass, (n, 4): the stop if there is one, then the goal's.
      goal: those of the goal alone, (m, 4).
      stop: the first of them if that is not a goal's, (4,), or None.
      length: radians of the wrist, which turns as long as the route takes.
    """

    def __init__(self, begin: np.ndarray, goal: np.ndarray, stop: np.ndarray | None = None) -> None:
        """Takes the joints at the beginning (k, 4), a goal's (m, 4), and those to pass before."""
        self.goal, self.stop = goal, stop
        self.stations = goal if stop is None else np.concatenate([stop[None], goal])
        self._bends = np.concatenate([begin, self.stations])
        lengths = _far(self._bends[:-1], self._bends[1:])
        self._passed = np.concatenate([[0.0], lengths.cumsum()])
        self.length = float(self._passed[-1])

    @functools.cached_property
    def _points(self) -> np.ndarray:
        """Joints along it, (n, 4)."""
        return self._at(self._places)

    @functools.cached_property
    def _places(self) -> np.ndarray:
        """How far along it these are, (n,), radians of the wrist."""
        return np.linspace(0.0, self.length, 2 + int(self.length / _SPACING))

    def _at(self, places: np.ndarray) -> np.ndarray:
        """Joints so far along it, (n,) -> (n, 4)."""
        return np.stack([np.interp(places, self._passed, j) for j in self._bends.T], axis=-1)

    def remaining(self, joints: np.ndarray) -> np.ndarray:
        """How long the way is from joints to the end, (n, 4) -> (n,), radians."""
        aside = _far(joints[:, None], self._points)
        is_behind = self._places > self._passed[1]  # the first bend
        cut = is_behind * np.maximum(aside - _CORNER, 0.0)
        return (_RETURN * aside + _CUT * cut + (self.length - self._places)).min(axis=-1)

    def ahead(self, stride: float, count: int) -> np.ndarray:
        """Joints to pass, (count, 4), a stride in radians from one to the next."""
        return self._at(stride * np.arange(1, count + 1))


def routes(
    random: np.random.Generator,
    now: np.ndarray,
    goals: np.ndarray,
    reach: float,
    count: int = 6,
    known: Sequence[Route] = (),
    around: np.ndarray | None = None,
    first: np.ndarray | None = None,
) -> list[Route]:
    """The shortest clear routes, at most `count`; none if nothing is clear.

    Args:
      random: draws the stops.
      now: the arm's joints, (4,).
      goals: joints to reach, and others to pass from there on in any case, (n, m, 4); the root may
        turn either way.
      reach: from the wrist to the far end of what is in the hand, metres.
      count: how many at most.
      known: routes of before, whose stops are tried again: who looks for a new way at each step
        gets nowhere.
      around: a line that the hand keeps clear of up to the goal, (2, 2) of its ends, metres.
      first: joints to pass first, (4,), to get away from where nothing is clear.
    """
    if not len(goals):
        return []
    begin = now[None] if first is None else np.stack([now, first])
    now = begin[-1]
    turn = 2 * np.pi * np.array([1.0, 0.0, 0.0, 0.0])
    goals = np.concatenate([goals, goals + turn, goals - turn])
    nearest = np.argsort(_far(now, goals[:, 0]), kind="stable")
    goals = goals[nearest[: max(len(goals) // 3, _ENDS)]]
    ends = goals[:, 0]
    draws = _STOPS if known else 4 * _STOPS  # who has to choose now looks further
    stops = now + random.uniform(-1.0, 1.0, (draws, 4)) * np.array([np.pi, 3.0, 3.0, 2.5])
    before = [route.stop[None] for route in known if route.stop is not None]
    stops = np.concatenate([*before, stops])
    stops = stops[is_clear(stops, reach) & _is_straight_clear(now, stops, reach, around)]
    direct = _is_straight_clear(now, ends, reach, around)
    found = [Route(begin, goal) for goal in goals[direct][:count]]
    for stop, end in _onwards(now, stops, ends, count, reach, around):
        found.append(Route(begin, goals[end], stops[stop]))
    return sorted(found, key=lambda route: route.length)[:count]


def kept(
    now: np.ndarray,
    known: Sequence[Route],
    reach: float,
    around: np.ndarray | None = None,
    first: np.ndarray | None = None,
) -> list[Route]:
    """Those of known routes that are still clear from now on, without their stops if possible.

    Takes what `routes` takes, and is much quicker: it looks for no other.
    """
    if not known:
        return []
    begin = now[None] if first is None else np.stack([now, first])
    ends = [route.goal[0] for route in known]
    ends += [route.stations[0] for route in known]
    direct, to_stop = np.split(_is_straight_clear(begin[-1], np.array(ends), reach, around), 2)
    found = [
        Route(begin, route.goal, None if is_direct else route.stop)
        for route, is_direct, is_clear_to_stop in zip(known, direct, to_stop, strict=True)
        if is_direct or is_clear_to_stop
    ]
    return sorted(found, key=lambda route: route.length)


def _onwards(
    now: np.ndarray,
    stops: np.ndarray,
    ends: np.ndarray,
    count: int,
    reach: float,
    around: np.ndarray | None,
) -> list[tuple[int, int]]:
    """The stops (n, 4) with the shortest clear paths from now to an end (m, 4), and those ends.

    Few are looked at: the shortest first, until that many stops have been found, or a few more.
    """
    lengths = _far(now, stops)[:, None] + _far(stops[:, None], ends)
    shortest = np.argsort(lengths, axis=None, kind="stable")
    found: dict[int, int] = {}
    for first in range(0, len(shortest), _AT_ONCE):
        stop, end = np.divmod(shortest[first : first + _AT_ONCE], len(ends))
        clear = _is_straight_clear(stops[stop], ends[end], reach, around)
        for one, other in zip(stop[clear].tolist(), end[clear].tolist(), strict=True):
            found.setdefault(one, other)
        if len(found) >= count:
            break
    return list(found.items())[:count]


def _far(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """How far the joint turns that takes longest, (..., 4) -> (...), radians of the wrist."""
    ways = _TIMES * np.abs(end - start)
    # Quicker than `max` over so short an axis.
    first, last = np.maximum(ways[..., 0], ways[..., 1]), np.maximum(ways[..., 2], ways[..., 3])
    return np.maximum(first, last)


def _is_straight_clear(
    start: np.ndarray, ends: np.ndarray, reach: float, around: np.ndarray | None
) -> np.ndarray:
    """Whether straight joint paths keep clear, (..., 4) -> (...)."""
    start = np.broadcast_to(start, np.broadcast_shapes(start.shape, ends.shape))[..., None, :]
    points = start + _POINTS[:, None] * (ends[..., None, :] - start)
    # What is nearer to the floor now, such as a hand that takes something up, may be as near later.
    low = np.minimum(hand_height(start) - 0.001, _KEPT)
    clear = is_clear(points, reach) & (hand_height(points) > low)
    if around is not None:
        clear &= hand_gap(points, around) > np.minimum(hand_gap(start, around) - 0.001, _GAP)
    return np.all(clear, axis=-1)
