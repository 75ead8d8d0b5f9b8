"""Ways of the planar arm over what stands in between: up, over the end and down.

paths = ways_over(settings, now, pose, 0.1, GRASP, 0.0, [OPEN, CLOSED])  # (knots, 5) each
"""

from typing import Any

import numpy as np

from limberjack.planner.arm import ARM, OPEN, PLANE, path
from limberjack.planner.cost import Settings
from limberjack.planner.planar_ik import GRASP, direction, hand_places, hand_poses, hand_route

__all__ = ["later", "leaving", "ways_over"]

_SPEEDS = (0.4, 0.8, 1.5)  # metres per second, at which a way is tried
_AT_ONCE = 0.011  # metres; a way back or up that is shorter is no stage of its own


def ways_over(
    settings: Settings,
    now: np.ndarray,
    pose: np.ndarray,
    cruise: float,
    forward: float,
    lateral: float,
    grasp: list[float],
    back: float = 0.0,
) -> list[np.ndarray]:
    """Paths up to a height, over the end and down to it, (knots, 5) each.

    Args:
      settings: of the plans that they are for.
      now, pose: the arm's joints at the start and the end, (4,).
      cruise: the least height of what is moved, metres.
      forward, lateral: where in the hand that is.
      grasp: its control on the way and at the end.
      back: how far to back off first, along the hand, metres.
    """
    start, end = hand_places(np.array([now, pose]), forward, lateral)
    stations = np.array([start, start - back * direction(now.sum()), end, end])
    stations[1:3, 1] = np.maximum(stations[1:3, 1], cruise)
    lengths = np.append(0.0, np.cumsum(np.hypot(*np.diff(stations, axis=0).T)))
    ways: list[np.ndarray] = []
    times = settings.horizon / (settings.knots - 1) * np.arange(settings.knots)
    for speed in _SPEEDS:
        gone = speed * times
        gone[1:] -= max(gone[1] - lengths[1], 0.0) * (lengths[1] > _AT_ONCE)
        gone = np.minimum(gone, lengths[-1])
        points = np.column_stack([np.interp(gone, lengths, part) for part in stations.T])
        parts = np.clip((gone - lengths[1]) / max(lengths[3] - lengths[1], 1e-6), 0.0, 1.0)
        joints = hand_route(now, pose, points, parts, forward, lateral)
        if np.isfinite(joints).all():
            hold = np.where(gone < lengths[-1], grasp[0], grasp[1])
            ways.append(np.column_stack([joints, hold]))
    straight = path(now, [pose], settings.knots, grasp, 2)
    straight[:, 4] = np.where(np.arange(settings.knots) < 3, grasp[0], grasp[1])
    return [*ways, straight]


def later(ways: list[np.ndarray]) -> list[np.ndarray]:
    """The same paths one knot later, the hand opening first."""
    delayed = [np.vstack([way[:1], way[:-1]]) for way in ways]
    for way in delayed:
        way[0, -1] = OPEN
    return delayed


def leaving(settings: Settings, data: Any, random: np.random.Generator) -> list[np.ndarray]:
    """Paths of the open hand back along its fingers, at once or when they have opened."""
    now = data.qpos[ARM]
    hand, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
    ways: list[np.ndarray] = []
    for back in (0.06, 0.15):
        behind = hand - back * direction(angle)
        for pose in hand_poses(random, behind, GRASP, now, 2, angle, 0.2):
            ways.extend(ways_over(settings, now, pose, 0.0, GRASP, 0.0, [OPEN, OPEN]))
    return ways + later(ways)
