"""Ways of the planar arm over what stands in between: up, over the end and down.

paths = ways_over(settings, now, poses, 0.1, GRASP, 0.0, [OPEN, CLOSED])  # (n, knots, 5)
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from limberjack.planner.arm import ARM, OPEN, PLANE, TIP_ASIDE, TIP_REACH, path
from limberjack.planner.cost import Settings
from limberjack.planner.planar_ik import (
    GRASP,
    angle_of,
    direction,
    hand_places,
    hand_poses_each,
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
    poses: np.ndarray,
    cruise: float,
    forward: float,
    lateral: float,
    grasp: ArrayLike,
    back: float = 0.0,
) -> np.ndarray:
    """Paths up to a height, over the end and down to it, (n, knots, 5).

    Args:
      settings: of the plans that they are for.
      now: the arm's joints at the start, (4,).
      poses: those at the end, of each way, (P, 4).
      cruise: the least height of what is moved, metres.
      forward, lateral: where in the hand that is.
      grasp: its control on the way and at the end, (2,) or, for each way, (P, 2).
      back: how far to back off first, along the hand, metres.
    """
    slow = round(_STRAIGHT / settings.spacing)
    grasp = np.broadcast_to(grasp, (len(poses), 2))
    straight = path(now, poses[:, None], settings.knots, [OPEN], slow)
    straight[..., 4] = np.where(np.arange(settings.knots) <= slow, grasp[:, :1], grasp[:, 1:])
    stations = _stations(now, poses, cruise, forward, lateral, back)
    steps = np.diff(stations, axis=1)
    strides = np.hypot(steps[..., 0], steps[..., 1])
    ends = np.cumsum(strides, axis=1)[..., None, None]
    up, total = ends[:, 0], ends[:, -1]
    times = settings.horizon / (settings.knots - 1) * np.arange(settings.knots)
    gone = np.repeat((np.array(_SPEEDS)[:, None] * times)[None], len(poses), axis=0)
    # A way back or up is a stage of its own, at whose end a knot stops.
    late = np.maximum(gone[..., 1:2] - up, 0.0)
    gone[..., 1:] -= np.where(up > _AT_ONCE, late, 0.0)
    gone = np.minimum(gone, total)
    points = _along(stations, strides, gone)
    parts = np.clip((gone - up) / np.maximum(total - up, 1e-6), 0.0, 1.0)
    joints = hand_route(now, poses[:, None], points, parts, forward, lateral)
    hold = np.where(gone < total, grasp[:, :1, None], grasp[:, 1:, None])
    routes = np.concatenate([joints, hold[..., None]], axis=-1)
    return np.concatenate([routes[np.isfinite(joints).all(axis=(-2, -1))], straight])


def _stations(
    now: np.ndarray,
    poses: np.ndarray,
    cruise: float,
    forward: float,
    lateral: float,
    back: float,
) -> np.ndarray:
    """Where what is moved begins, is up, is over its end, and ends, (P, 4, 2), metres."""
    start, *ends = hand_places(np.concatenate([now[None], poses]), forward, lateral)
    stations = np.empty((len(poses), 4, 2))
    stations[:, 0] = start
    stations[:, 1] = start - back * direction(now.sum())
    stations[:, 2:] = np.reshape(ends, (-1, 1, 2))
    stations[:, 1:3, 1] = np.maximum(stations[:, 1:3, 1], cruise)
    return stations


def _along(stations: np.ndarray, strides: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Where who has gone so far is, (P, ...) -> (P, ..., 2), for stations (P, n, 2), metres."""
    places = np.repeat(stations[:, None, None, 0], gone.shape[-1], axis=2)
    left = gone
    for station in range(strides.shape[1]):
        stride = strides[:, station, None, None]
        here = np.minimum(left, stride)
        part = here / np.maximum(stride, 1e-9)
        step = stations[:, station + 1] - stations[:, station]
        places = places + part[..., None] * step[:, None, None]
        left = left - here
    return places


def later(settings: Settings, ways: np.ndarray) -> np.ndarray:
    """The same paths (n, knots, 5) a little later, the hand opening first."""
    knots = round(_OPENING / settings.spacing)
    delayed = np.concatenate([np.repeat(ways[:, :1], knots, axis=1), ways[:, :-knots]], axis=1)
    delayed[:, :knots, -1] = OPEN
    return delayed


def leaving(settings: Settings, data: Any, random: np.random.Generator) -> np.ndarray:
    """Paths of the open hand back along its fingers, at once or when they have opened."""
    now = data.qpos[ARM]
    hand, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
    behind = hand - np.array([[0.06], [0.15]]) * direction(angle)
    poses = np.concatenate(hand_poses_each(random, behind, GRASP, now, 2, angle, 0.2))
    ways = ways_over(settings, now, poses, 0.0, GRASP, 0.0, [OPEN, OPEN])
    return np.concatenate([ways, later(settings, ways)])


def turning_over(
    settings: Settings,
    now: np.ndarray,
    box: np.ndarray,
    side: float,
    random: np.random.Generator,
) -> np.ndarray:
    """Paths of a fingertip that turns a box over, (n, knots, 5).

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
    sides = np.array([-TIP_ASIDE, TIP_ASIDE])  # a tower leaves room for one of the fingers
    press = points[[0, 0]], TIP_REACH, now, 3, down, 0.4, sides
    for aside, poses in zip(sides.tolist(), hand_poses_each(random, *press), strict=True):
        routes = hand_route(poses, poses, points, np.zeros(4), TIP_REACH, aside)
        routes = routes[np.isfinite(routes).all(axis=(-2, -1))]
        parts = [routes[:, first:] for first in range(3)]
        ways.extend(path(now, part, settings.knots, [OPEN], slow) for part in parts)
    return np.concatenate(ways)
