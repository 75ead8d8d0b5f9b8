"""Plans of the arm over objects: up, above the goal and down.

    plans = plans_over(settings, now, poses, 0.1, GRASP, 0.0, [OPEN, CLOSED])  # (n, knots, 5)

The hand, or what it holds, follows straight lines in the plane; the joints follow from inverse
kinematics, from the current joints to those of the goal.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from limberjack.planner.arm.hand import ARM, OPEN, PLANE, TIP_ASIDE, TIP_REACH
from limberjack.planner.arm.kinematics import (
    GRASP,
    direction,
    hand_places,
    hand_poses_each,
    joints_along,
)
from limberjack.planner.arm.proposals import plans_along
from limberjack.planner.settings import Settings
from limberjack.planner.stacker.boxes import DOWN

__all__ = ["later", "leaving", "plans_over", "turning_over"]


def plans_over(
    settings: Settings,
    now: np.ndarray,
    poses: np.ndarray,
    cruise: float,
    forward: float,
    lateral: float,
    grasp: ArrayLike,
    back: float = 0.0,
) -> np.ndarray:
    """Plans up to a height, over the end and down to it, (n, knots, 5).

    Args:
      settings: the planner's.
      now: the arm's joints at the start, (4,).
      poses: the joints at the end of each plan, (P, 4).
      cruise: smallest height of the moved point, metres.
      forward, lateral: that point in the hand.
      grasp: its control along the path and at the end, (2,) or, for each plan, (P, 2).
      back: distance to back off first, along the hand, metres.
    """
    slow = round(0.25 / settings.spacing)  # seconds of a straight joint path, in knots
    grasp = np.broadcast_to(grasp, (len(poses), 2))
    straight = plans_along(now, poses[:, None], settings.knots, [OPEN], slow)
    straight[..., 4] = np.where(np.arange(settings.knots) <= slow, grasp[:, :1], grasp[:, 1:])
    waypoints = _waypoints(now, poses, cruise, forward, lateral, back)
    steps = np.diff(waypoints, axis=1)
    strides = np.hypot(steps[..., 0], steps[..., 1])
    ends = np.cumsum(strides, axis=1)[..., None, None]
    up, total = ends[:, 0], ends[:, -1]
    times = settings.spacing * np.arange(settings.knots)
    gone = np.multiply.outer([0.4, 0.8, 1.5], times)  # metres, at three speeds
    # A path back or up of more than 30 mm is a leg of its own, at whose end a knot stops.
    late = np.where(up > 0.03, np.maximum(gone[:, 1:2] - up, 0.0), 0.0)
    gone = np.minimum(gone - late * (times > 0.0), total)
    points = _along(waypoints, strides, gone)
    parts = np.clip((gone - up) / np.maximum(total - up, 1e-6), 0.0, 1.0)
    joints = joints_along(now, poses[:, None], points, parts, forward, lateral)
    hold = np.where(gone < total, grasp[:, :1, None], grasp[:, 1:, None])
    joints = np.concatenate([joints, hold[..., None]], axis=-1)
    return np.concatenate([joints[np.isfinite(joints).all(axis=(-2, -1))], straight])


def _waypoints(
    now: np.ndarray, poses: np.ndarray, cruise: float, forward: float, lateral: float, back: float
) -> np.ndarray:
    """Positions of the moved point: start, up, over the end, end, (P, 4, 2), metres."""
    start, *ends = hand_places(np.concatenate([now[None], poses]), forward, lateral)
    waypoints = np.empty((len(poses), 4, 2))
    waypoints[:, 0] = start
    waypoints[:, 1] = start - back * direction(now.sum())
    waypoints[:, 2:] = np.reshape(ends, (-1, 1, 2))
    waypoints[:, 1:3, 1] = np.maximum(waypoints[:, 1:3, 1], cruise)
    return waypoints


def _along(waypoints: np.ndarray, strides: np.ndarray, gone: np.ndarray) -> np.ndarray:
    """Positions at arc lengths along waypoints (P, n, 2), (P, ...) -> (P, ..., 2), metres."""
    places = np.repeat(waypoints[:, None, None, 0], gone.shape[-1], axis=2)
    left = gone
    for leg in range(strides.shape[1]):
        stride = strides[:, leg, None, None]
        here = np.minimum(left, stride)
        part = here / np.maximum(stride, 1e-9)
        step = waypoints[:, leg + 1] - waypoints[:, leg]
        places = places + part[..., None] * step[:, None, None]
        left = left - here
    return places


def later(settings: Settings, plans: np.ndarray) -> np.ndarray:
    """The same plans (n, knots, 5) a little later, after the hand has opened."""
    knots = round(0.125 / settings.spacing)  # seconds, in knots
    delayed = np.concatenate([np.repeat(plans[:, :1], knots, axis=1), plans[:, :-knots]], axis=1)
    delayed[:, :knots, -1] = OPEN
    return delayed


def leaving(settings: Settings, data: Any, random: np.random.Generator) -> np.ndarray:
    """Plans of the open hand back along its fingers, at once or after they have opened."""
    now = data.qpos[ARM]
    hand, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
    behind = hand - np.array([[0.06], [0.15]]) * direction(angle)
    poses = np.concatenate(hand_poses_each(random, behind, GRASP, now, 2, angle, 0.2))
    plans = plans_over(settings, now, poses, 0.0, GRASP, 0.0, [OPEN, OPEN])
    return np.concatenate([plans, later(settings, plans)])


def turning_over(
    settings: Settings, now: np.ndarray, box: np.ndarray, side: float, random: np.random.Generator
) -> np.ndarray:
    """Plans of a fingertip that turns a box at x and z over to a side, 1 or -1, (n, knots, 5)."""
    # Metres sideways and up from the middle; the fingertip presses on the far half and drags.
    points = box + np.array([[0.01, 0.05], [0.01, 0.02], [0.05, 0.01], [0.1, 0.0]]) * [side, 1.0]
    slow = round(0.125 / settings.spacing)  # seconds from one point to the next, in knots
    plans: list[np.ndarray] = []
    sides = np.array([-TIP_ASIDE, TIP_ASIDE])  # a tower leaves room for one of the fingers
    press = points[[0, 0]], TIP_REACH, now, 3, DOWN, 0.4, sides
    for aside, poses in zip(sides.tolist(), hand_poses_each(random, *press), strict=True):
        joints = joints_along(poses, poses, points, np.zeros(4), TIP_REACH, aside)
        joints = joints[np.isfinite(joints).all(axis=(-2, -1))]
        parts = [joints[:, first:] for first in range(3)]
        plans.extend(plans_along(now, part, settings.knots, [OPEN], slow) for part in parts)
    return np.concatenate(plans)
