"""Routes of the planar arm that keep clear of floor and walls.

    found = routes(random, now=qpos[:4], goals=poses, reach=0.178)  # shortest first

A route is a straight joint path to one of the goals, or two by way of a stop that is drawn. It
knows nothing of objects on the way.
"""

import dataclasses

import numpy as np

from limberjack.planner.planar_ik import is_clear

__all__ = ["Route", "routes"]

_STOPS = 80  # that are drawn
_POINTS = np.arange(1, 7) / 6  # of a straight path, where it is looked at


@dataclasses.dataclass(frozen=True)
class Route:
    """Where to go next, and then.

    Attributes:
      stations: joints, (1 or 2, 4); the last are a goal.
      rest: radians from the first to the last.
    """

    stations: np.ndarray
    rest: float


def routes(
    random: np.random.Generator, now: np.ndarray, goals: np.ndarray, reach: float, count: int = 6
) -> list[Route]:
    """The shortest clear routes, at most `count`; none if nothing is clear.

    Args:
      random: draws the stops.
      now: the arm's joints, (4,).
      goals: joints to reach, (n, 4); the root may turn either way.
      reach: from the wrist to the far end of what is in the hand, metres.
      count: how many at most.
    """
    if not len(goals):
        return []
    turn = 2 * np.pi * np.array([[1.0, 0.0, 0.0, 0.0]])
    ends = np.concatenate([goals, goals + turn, goals - turn])
    stops = now + random.uniform(-1.0, 1.0, (_STOPS, 4)) * np.array([np.pi, 3.0, 3.0, 2.5])
    stops = stops[is_clear(stops, reach) & _is_straight_clear(now, stops, reach)]
    left = np.abs(ends - stops[:, None]).max(axis=-1)
    onwards = _is_straight_clear(stops[:, None], ends, reach)
    left = np.where(onwards, left, np.inf)
    direct = _is_straight_clear(now, ends, reach)
    found = [(_far(now, end), Route(end[None], 0.0)) for end in ends[direct]]
    for stop, ways in zip(stops, left, strict=True):
        best = int(np.argmin(ways))
        if np.isfinite(ways[best]):
            route = Route(np.stack([stop, ends[best]]), float(ways[best]))
            found.append((_far(now, stop) + route.rest, route))
    order = np.argsort([length for length, _ in found], kind="stable")
    return [found[place][1] for place in order[:count]]


def _far(start: np.ndarray, end: np.ndarray) -> float:
    """How far the joint turns that turns furthest, radians."""
    return float(np.abs(end - start).max())


def _is_straight_clear(start: np.ndarray, ends: np.ndarray, reach: float) -> np.ndarray:
    """Whether straight joint paths keep clear, (..., 4) -> (...)."""
    start = np.broadcast_to(start, np.broadcast_shapes(start.shape, ends.shape))[..., None, :]
    points = start + _POINTS[:, None] * (ends[..., None, :] - start)
    return np.all(is_clear(points, reach), axis=-1)
