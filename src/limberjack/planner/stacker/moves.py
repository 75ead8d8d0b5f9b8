"""Plans of the arm in the stages of a tower: to the next box, with it to its place, and away.

    plans = reaching(tower, data, random)   # (n, knots, 5)
    plans = carrying(tower, data, random)
    plans = plans_over(now, poses, 0.1, GRASP, 0.0, [OPEN, CLOSED])

The hand, or what it holds, follows straight lines in the plane; the joints follow from inverse
kinematics, from the current joints to those of the goal. `data` is that of a single simulation.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.arm.hand import (
    ARM,
    CLOSED,
    OPEN,
    PLANE,
    SETTINGS,
    TIP_ASIDE,
    TIP_REACH,
    closing,
    in_hand,
)
from limberjack.planner.arm.kinematics import (
    GRASP,
    direction,
    hand_places,
    hand_poses,
    hand_poses_each,
    joints_along,
)
from limberjack.planner.arm.proposals import plans_along
from limberjack.planner.optimisers.mppi import MPPI
from limberjack.planner.stacker.box_grip import HIGH, PRESS, ready
from limberjack.planner.stacker.tower import FREE, FROM_WALL, HALF, PASSES, Tower, crest, length

__all__ = [
    "FREE_OF_TOWER",
    "OVER",
    "STACKING",
    "UNDER_HAND",
    "carrying",
    "later",
    "leaving",
    "plans_over",
    "plans_to",
    "reaching",
    "refuge",
    "shelter",
    "turning_over",
]

STACKING = dataclasses.replace(
    SETTINGS,
    samples=36,
    horizon=0.45,
    # A new plan reaches a target at the next knot at the earliest.
    knots=9,
    optimiser=MPPI(temperature=0.1),
    armature=1e-3,
    flowing=True,
    cost_interval=3,
    proposal_interval=2,
    servos=True,
    sleep=True,
)
FREE_OF_TOWER = 0.08  # metres from a box to a tower, so that the hand fits between
UNDER_HAND = 0.045  # metres that the open fingers need below the grasp
OVER = 0.03  # metres above its place at which a box is carried to it
_DOWN = -np.pi  # radians; angle of a hand that points down
_KNOTS, _SPACING = STACKING.knots, STACKING.spacing


def reaching(tower: Tower, data: NamedFields, random: np.random.Generator) -> np.ndarray:
    """Plans from above onto the next box, closing there."""
    now, box = data.qpos[ARM], data.site_xpos[tower.next][PLANE]
    hand = data.site_xpos["grasp"][PLANE]
    highest = crest(data, [*tower.others, str(tower.next)], float(hand[0]), float(box[0]))
    between = data.site_xpos[tower.others] - data.site_xpos["pinch"]
    back = 0.07 if (length(between[:, PLANE]) < 2.0 * HALF).any() else 0.0
    points = box + np.array([[0.0, HIGH], [0.0, HIGH], [0.0, 0.09]])
    is_there = length(points[0] - hand) < 0.02  # metres
    hold = ready(float(closing(data)))
    grasp = [CLOSED if is_there else hold, CLOSED]
    # Further out than 0.33 m a hand that points down does not reach the floor.
    tilts = np.array([0.1, 0.8 if abs(box[0]) > 0.33 else 0.4, 0.4])
    found = hand_poses_each(random, points, GRASP, now, 2, _DOWN, tilts)
    grasps = np.repeat([grasp, grasp, [hold, hold]], [len(poses) for poses in found], axis=0)
    poses = np.concatenate(found)
    plans = plans_over(now, poses, highest + UNDER_HAND, GRASP, 0.0, grasps, back)
    delayed = [later(plans)] if back else []
    return np.concatenate([*_parting(tower, data, random), plans, *delayed])


def _parting(tower: Tower, data: NamedFields, random: np.random.Generator) -> list[np.ndarray]:
    """Plans of a fingertip that turns the next box away from one that fingers cannot pass."""
    box = data.site_xpos[tower.next]
    free = FREE_OF_TOWER if len(tower.placed) > 1 else FREE
    others = data.site_xpos[tower.others] - box
    near_by = [float(o[0]) for o in others if abs(o[2]) < HALF and abs(o[0]) < free]
    if abs(box[0]) > FROM_WALL:
        near_by.append(float(box[0]))
    if not near_by or np.sign(min(near_by)) != np.sign(max(near_by)):
        return []
    return [turning_over(data.qpos[ARM], box[PLANE], -float(np.sign(near_by[0])), random)]


def turning_over(
    now: np.ndarray, box: np.ndarray, side: float, random: np.random.Generator
) -> np.ndarray:
    """Plans of a fingertip that turns a box at x and z over to a side, 1 or -1, (n, knots, 5)."""
    # Metres sideways and up from the middle; the fingertip presses on the far half and drags.
    points = box + np.array([[0.01, 0.05], [0.01, 0.02], [0.05, 0.01], [0.1, 0.0]]) * [side, 1.0]
    slow = round(0.125 / _SPACING)  # seconds from one point to the next, in knots
    plans: list[np.ndarray] = []
    sides = np.array([-TIP_ASIDE, TIP_ASIDE])  # a tower leaves room for one of the fingers
    press = points[[0, 0]], TIP_REACH, now, 3, _DOWN, 0.4, sides
    for aside, poses in zip(sides.tolist(), hand_poses_each(random, *press), strict=True):
        joints = joints_along(poses, poses, points, np.zeros(4), TIP_REACH, aside)
        joints = joints[np.isfinite(joints).all(axis=(-2, -1))]
        parts = [joints[:, first:] for first in range(3)]
        plans.extend(plans_along(now, part, _KNOTS, [OPEN], slow) for part in parts)
    return np.concatenate(plans)


def carrying(tower: Tower, data: NamedFields, random: np.random.Generator) -> np.ndarray:
    """Plans up, over the place of the next box and down, so that it lies flat there."""
    now, place, box = data.qpos[ARM], tower.place, data.site_xpos[tower.next]
    ahead, aside = (float(part) for part in in_hand(data, box))
    turn = float(data.qpos[f"{tower.next}_y"].item())
    flat = float(now.sum()) + (turn + np.pi / 4) % (np.pi / 2) - np.pi / 4
    start, end = float(box[0]), float(place[0])

    def height(until: float) -> float:  # at which the box passes others on its way; 0 if none
        highest = crest(data, tower.others, start, until)
        return highest + PASSES if highest else 0.0

    cruise = max(height(end), float(place[2]) + OVER)
    goals = place[PLANE] + np.array([[0.0, 0.0], [0.0, 0.0], [0.0, OVER]])
    far = height(end) > 0.0 and abs(start - end) > 0.15  # metres
    if far:  # first to where the box has risen, 0.13 m before the tower's middle
        goals[:] = end + np.copysign(0.13, start - end), cruise
        cruise = min(cruise, max(height(float(goals[0, 0])), 0.06))  # metres
    tilts = np.array([0.05, 0.4, 0.4])
    found = hand_poses_each(random, goals, GRASP + ahead, now, 2, flat, tilts, aside)
    found[2] = found[2][:1]
    let_go = [PRESS, PRESS if far else OPEN]
    grasp = np.repeat([let_go, let_go, [PRESS, PRESS]], [len(some) for some in found], axis=0)
    return plans_over(now, np.concatenate(found), cruise, GRASP + ahead, aside, grasp)


def leaving(data: NamedFields, random: np.random.Generator) -> np.ndarray:
    """Plans of the open hand back along its fingers, at once or after they have opened."""
    now = data.qpos[ARM]
    hand, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
    behind = hand - np.array([[0.06], [0.15]]) * direction(angle)
    poses = np.concatenate(hand_poses_each(random, behind, GRASP, now, 2, angle, 0.2))
    plans = plans_over(now, poses, 0.0, GRASP, 0.0, [OPEN, OPEN])
    return np.concatenate([plans, later(plans)])


def later(plans: np.ndarray) -> np.ndarray:
    """The same plans (n, knots, 5) a little later, after the hand has opened."""
    knots = round(0.125 / _SPACING)  # seconds, in knots
    delayed = np.concatenate([np.repeat(plans[:, :1], knots, axis=1), plans[:, :-knots]], axis=1)
    delayed[:, :knots, -1] = OPEN
    return delayed


def plans_over(
    now: np.ndarray,  # the arm's joints at the start, (4,)
    poses: np.ndarray,  # those at the end of each plan, (P, 4)
    cruise: float,  # smallest height of the moved point on the way, metres
    forward: float,  # that point in the hand
    lateral: float,
    grasp: ArrayLike,  # its control along the path and at the end, (2,) or (P, 2)
    back: float = 0.0,  # distance to back off first, along the hand, metres
) -> np.ndarray:
    """Plans up to a height, over the end and down to it, and straight ones, (n, knots, 5)."""
    slow = round(0.25 / _SPACING)  # seconds of a straight joint path, in knots
    grasp = np.broadcast_to(grasp, (len(poses), 2))
    straight = plans_along(now, poses[:, None], _KNOTS, [OPEN], slow)
    straight[..., 4] = np.where(np.arange(_KNOTS) <= slow, grasp[:, :1], grasp[:, 1:])
    # The moved point's positions: now, back and up, over the end, and at the end.
    waypoints = np.empty((len(poses), 4, 2))
    start, *ends = hand_places(np.concatenate([now[None], poses]), forward, lateral)
    waypoints[:, 0], waypoints[:, 1] = start, start - back * direction(now.sum())
    waypoints[:, 2:] = np.reshape(ends, (-1, 1, 2))
    waypoints[:, 1:3, 1] = np.maximum(waypoints[:, 1:3, 1], cruise)
    steps = np.diff(waypoints, axis=1)[:, :, None, None]
    strides = length(steps)  # (P, 3, 1, 1)
    up, _, total = np.cumsum(strides, axis=1).swapaxes(0, 1)
    times = _SPACING * np.arange(_KNOTS)
    gone = np.multiply.outer([0.4, 0.8, 1.5], times)  # metres, at three speeds
    # A path back or up of more than 30 mm is a leg of its own, at whose end a knot stops.
    late = np.where(up > 0.03, np.maximum(gone[:, 1:2] - up, 0.0), 0.0)
    gone = np.minimum(gone - late * (times > 0.0), total)
    points, left = waypoints[:, None, None, 0], gone
    for leg in range(3):
        here = np.minimum(left, strides[:, leg])
        points = points + (here / np.maximum(strides[:, leg], 1e-9))[..., None] * steps[:, leg]
        left = left - here
    parts = np.clip((gone - up) / np.maximum(total - up, 1e-6), 0.0, 1.0)
    joints = joints_along(now, poses[:, None], points, parts, forward, lateral)
    hold = np.where(gone < total, grasp[:, :1, None], grasp[:, 1:, None])
    joints = np.concatenate([joints, hold[..., None]], axis=-1)
    return np.concatenate([joints[np.isfinite(joints).all(axis=(-2, -1))], straight])


def refuge(data: NamedFields, place: np.ndarray, tries: int) -> np.ndarray:
    """Joints of the arm, (4,), with the hand above a place; other ones at each try."""
    random = np.random.default_rng(tries)
    # Metres; there the hand is out of the way, and the arm not folded.
    poses = _pointing_down(data, random, [np.copysign(0.25, place[0]), 0.25], 24)
    return poses[random.integers(len(poses))]


def shelter(data: NamedFields) -> np.ndarray:
    """Joints of the arm, (4,), with as little of it as can be below where boxes fall."""
    poses = _pointing_down(data, np.random.default_rng(0), [-0.03, 0.18], 48)
    corners = -np.cumsum(np.sin(np.cumsum(poses[:, :3], axis=-1)) * GEOMETRY.lengths, axis=-1)  # x
    # Boxes fall further right than 60 mm.
    return poses[int(np.argmin(np.maximum(corners - 0.06, 0.0).max(axis=-1)))]


def _pointing_down(
    data: NamedFields, random: np.random.Generator, place: list[float], count: int
) -> np.ndarray:
    """Joints with the hand at x and z, about downwards, (n, 4); the present ones if none reach."""
    now = data.qpos[ARM]
    poses = hand_poses(random, np.array(place), GRASP, now, count, _DOWN, 0.7)
    return poses if len(poses) else now[None].copy()


def plans_to(goal: np.ndarray, now: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Paths of the open hand to joints, and others that shake the arm, (n, knots, 5)."""
    others = now + random.uniform(-1.5, 1.5, (20, 1, 4))
    straight = [plans_along(now, [[goal]], _KNOTS, [OPEN], slow) for slow in (1, 2, 4)]
    return np.concatenate([*straight, plans_along(now, others, _KNOTS, [OPEN])])
