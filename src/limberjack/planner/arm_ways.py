"""Ways of the planar arm over what stands in between: up, over the end and down.

paths = ways_over(settings, now, pose, 0.1, GRASP, 0.0, [OPEN, CLOSED])  # (knots, 5) each
"""

from typing import Any

import numpy as np

from limberjack.planner.arm import ARM, OPEN, PLANE, TIP_ASIDE, TIP_REACH, path
from limberjack.planner.cost import Settings
from limberjack.planner.planar_ik import (
    GRASP,
    angle_of,
    direction,
    hand_places,
    hand_poses,
    hand_route,
)

__all__ = ["later", "leaving", "turning_over", "ways_over"]

_SPEEDS = (0.4, 0.8, 1.5)  # metres per second, at which a way is tried
_AT_ONCE = 0.03  # metres; a way back or up that is shorter is no stage of its own
_STRAIGHT = 0.25  # seconds, that a straight way of the joints takes
# Metres sideways and up from a box's middle; where a fingertip presses on its far half and drags.
_OVER_A_BOX = (0.01, 0.05), (0.01, 0.02), (0.05, 0.01), (0.1, 0.0)
_PUSH = 0.125  # seconds from one of these points to the next
_OPENING = 0.125  # seconds, in which a hand opens far enough to go


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
    times = settings.horizon / (settings.knots - 1) * np.arange(settings.knots)
    gone = np.array(_SPEEDS)[:, None] * times
    if lengths[1] > _AT_ONCE:
        gone[:, 1:] -= np.maximum(gone[:, 1:2] - lengths[1], 0.0)
    gone = np.minimum(gone, lengths[-1])
    points = np.stack([np.interp(gone, lengths, part) for part in stations.T], axis=-1)
    parts = np.clip((gone - lengths[1]) / max(lengths[3] - lengths[1], 1e-6), 0.0, 1.0)
    joints = hand_route(now, pose, points, parts, forward, lateral)
    hold = np.where(gone < lengths[-1], grasp[0], grasp[1])
    routes = np.concatenate([joints, hold[..., None]], axis=-1)
    ways = list(routes[np.isfinite(joints).all(axis=(-2, -1))])
    slow = round(_STRAIGHT / settings.spacing)
    straight = path(now, [pose], settings.knots, grasp, slow)
    straight[:, 4] = np.where(np.arange(settings.knots) <= slow, grasp[0], grasp[1])
    return [*ways, straight]


def later(settings: Settings, ways: list[np.ndarray]) -> list[np.ndarray]:
    """The same paths a little later, the hand opening first."""
    knots = round(_OPENING / settings.spacing)
    delayed = [np.vstack([np.repeat(way[:1], knots, axis=0), way[:-knots]]) for way in ways]
    for way in delayed:
        way[:knots, -1] = OPEN
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
    return ways + later(settings, ways)


def turning_over(
    settings: Settings,
    now: np.ndarray,
    box: np.ndarray,
    side: float,
    random: np.random.Generator,
) -> list[np.ndarray]:
    """Paths of a fingertip that turns a box over, (knots, 5) each.

    Args:
      settings: of the plans that they are for.
      now: the arm's joints at the start, (4,).
      box: x and z of its middle, (2,).
      side: to which it turns, 1 or -1.
      random: draws the poses.
    """
    points = box + np.array(_OVER_A_BOX) * [side, 1.0]
    down, slow = angle_of(np.array([0.0, -1.0])), round(_PUSH / settings.spacing)
    ways: list[np.ndarray] = []
    for aside in (-TIP_ASIDE, TIP_ASIDE):  # a tower leaves room for one of the fingers
        for pose in hand_poses(random, points[0], TIP_REACH, now, 3, down, 0.4, aside):
            route = hand_route(pose, pose, points, np.zeros(4), TIP_REACH, aside)
            if np.isfinite(route).all():
                parts = [list(route[first:]) for first in range(3)]
                ways.extend(path(now, part, settings.knots, [OPEN], slow) for part in parts)
    return ways
