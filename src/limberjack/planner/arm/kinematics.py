"""Inverse kinematics of the planar arm: joint angles that put the hand at a point.

    joints = hand_poses(random, point=(0.2, 0.1), forward=0.065, now=qpos[:4], count=8)  # (n, 4)

Points are (x, z) in metres. Angles are measured as the joints': 0 points up, growing from x to -x
over the top. The arm has four joints for three numbers, so a pose leaves one free, which is drawn.
Poses are within the joints' limits and off the floor and the walls. Objects and fingers are not
checked: fingers may touch the object that they grasp.
"""

import itertools
from typing import Any

import numpy as np

from limberjack.planner.arm.collision import (
    LIMITS,
    corners,
    direction_of,
    has_room,
    is_off_ground,
    within_limits,
)
from limberjack.planner.arm.geometry import GEOMETRY

__all__ = [
    "GRASP",
    "PINCH",
    "angle_of",
    "direction",
    "drawn_back",
    "hand_places",
    "hand_poses",
    "hand_poses_each",
    "joints_along",
    "nudged",
]

_UPPER, _MIDDLE, _LOWER = GEOMETRY.lengths
_BASE = GEOMETRY.base_height * 1j  # x + z i
GRASP, PINCH = GEOMETRY.grasp, GEOMETRY.pinch  # metres; from the wrist to sites between the fingers


def direction(angle: np.ndarray | float) -> np.ndarray:
    """The direction in which something at an angle points, (...) -> (..., 2)."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def angle_of(vector: np.ndarray) -> np.ndarray:
    """The angle at which vectors point, (..., 2) -> (...), radians."""
    return np.arctan2(-vector[..., 0], vector[..., 1])


def hand_places(joints: np.ndarray, forward: float, lateral: float = 0.0) -> np.ndarray:
    """Position of a point of the hand, for arm joints (..., 4) -> (..., 2), metres."""
    lengths = 1j * np.array([*GEOMETRY.lengths, forward - 1j * lateral])
    place = _BASE + (direction_of(np.cumsum(joints, axis=-1)) * lengths).sum(axis=-1)
    return np.stack([place.real, place.imag], axis=-1)


# Any: the further arguments of `hand_poses_each`.
def hand_poses(
    random: np.random.Generator, point: np.ndarray, *wanted: Any, **named: Any
) -> np.ndarray:
    """Arm joints that bring a point of the hand to a position (2,), (n, 4), n <= count.

    The further arguments, of any kind, are those of `hand_poses_each`.
    """
    return hand_poses_each(random, np.reshape(point, (1, 2)), *wanted, **named)[0]


def hand_poses_each(
    random: np.random.Generator,  # draws the hand's angle and the redundancy
    points: np.ndarray,  # the positions to reach, (R, 2), metres
    forward: float | np.ndarray,  # from the wrist to the hand's point, such as `GRASP`
    now: np.ndarray,  # the current joints, from which distances are measured, or (R, 4)
    count: int,  # largest number of poses
    angle: float | np.ndarray | None = None,  # the hand's; None for any
    tilt: float | np.ndarray = np.pi,  # largest deviation from that angle
    lateral: float | np.ndarray = 0.0,  # distance of the hand's point from its middle line
    width: float | None = None,  # of the fingertips from that line if they must be off the ground
    slack: float = 0.0,  # largest additional distance from the wrist
) -> list[np.ndarray]:
    """Arm joints that bring a point of the hand to each of several positions, (n, 4) each.

    The first half are the nearest to the current joints; the others are drawn from the rest. Both
    halves are sorted by distance. Forward, angle, tilt and lateral are for all points or (R,).
    """
    rows, draws = len(points), max(12 * count, 72)
    if not rows:
        return []
    tilt, forward = _of_each(tilt), _of_each(forward)
    pointing_to = _of_each(0.0 if angle is None else angle)
    hand = tilt * random.uniform(-1.0, 1.0, (rows, draws)) + pointing_to
    bend = random.uniform(-LIMITS[2], LIMITS[2], (rows, draws))
    ahead = forward + slack * random.uniform(0.0, 1.0, (rows, draws))
    place = (points[:, 0] + 1j * points[:, 1])[:, None]
    wrist = place - direction_of(hand) * (1j * ahead + _of_each(lateral))
    elbows = np.array([[[1.0], [-1.0]]])
    usable = _joints(wrist[:, None], hand[:, None], bend[:, None], elbows).reshape(rows, -1, 4)
    row, column = within_limits(usable).nonzero()
    usable, start = usable[row, column], now if np.ndim(now) == 1 else now[row]
    usable[:, 0] += 2 * np.pi * np.round((start[..., 0] - usable[:, 0]) / (2 * np.pi))
    pointing = direction_of(usable.cumsum(axis=-1))
    clear = is_off_ground(pointing)
    if width is not None:
        clear &= has_room(pointing, width)
    usable, far = usable[clear], np.abs(usable - start).max(axis=-1)[clear]
    ends = row[clear].searchsorted(np.arange(rows + 1))
    return [
        usable[b:e][_chosen(random, far[b:e], count)] for b, e in itertools.pairwise(ends.tolist())
    ]


def _of_each(values: np.ndarray | float) -> np.ndarray | float:
    """A number for all points unchanged, one for each of them as a column."""
    return values[:, None] if isinstance(values, np.ndarray) and values.ndim else values


def _chosen(random: np.random.Generator, far: np.ndarray, count: int) -> np.ndarray:
    """Indices of the poses to keep for distances (n,): the nearest, and random others."""
    nearest = np.argsort(far, kind="stable")
    near, others = nearest[: (count + 1) // 2], nearest[(count + 1) // 2 :]
    # Others too, because the path to the nearest may be blocked.
    drawn = np.sort(random.permutation(len(others))[: count // 2])
    return np.concatenate([near, others[drawn]])


def joints_along(
    now: np.ndarray,  # the joints at the start, (..., 4)
    pose: np.ndarray,  # those at the end, (..., 4)
    points: np.ndarray,  # the positions, (..., n, 2)
    parts: np.ndarray,  # of the path from `now` to `pose`, for the hand's angle and wrist, (..., n)
    forward: float,  # the point in the hand, as for `hand_poses_each`
    lateral: float = 0.0,
) -> np.ndarray:
    """Arm joints that bring a point of the hand to positions in turn, (..., n, 4).

    NaN where the arm cannot reach, and everywhere for an elbow that would have to turn over.
    """
    now, pose = now[..., None, :], pose[..., None, :]  # the same for all points of a path
    angle = now.sum(axis=-1)
    hand = angle + parts * (pose.sum(axis=-1) - angle)
    bend = now[..., 3] + parts * (pose[..., 3] - now[..., 3])
    wrist = points[..., 0] + 1j * points[..., 1] - direction_of(hand) * (1j * forward + lateral)
    elbow = np.where(now[..., 1] * pose[..., 1] < 0, np.nan, np.sign(pose[..., 1]))
    joints = _joints(wrist, hand, bend, elbow)
    # The root turns without jumps.
    turns = np.diff(joints[..., 0], prepend=np.broadcast_to(now[..., 0], (*joints.shape[:-2], 1)))
    joints[..., 0] -= 2 * np.pi * np.round(turns / (2 * np.pi)).cumsum(axis=-1)
    return joints


def drawn_back(poses: np.ndarray, by: float) -> np.ndarray:
    """The joints with the hand moved back along itself by metres at the same wrist angle, (n, 4).

    NaN where the arm cannot reach with its elbow on the same side.
    """
    hand = poses.sum(axis=-1)
    wrist = _axes(poses)[:, 3] - by * 1j * direction_of(hand)
    found = _joints(wrist, hand, poses[:, 3], np.sign(poses[:, 1]))
    found[:, 0] += 2 * np.pi * np.round((poses[:, 0] - found[:, 0]) / (2 * np.pi))
    clear = within_limits(found) & is_off_ground(direction_of(found.cumsum(axis=-1)))
    found[~clear] = np.nan
    return found


def nudged(joints: np.ndarray, by: np.ndarray, turn: np.ndarray | float) -> np.ndarray:
    """Joints (..., 4) that move the wrist by metres (..., 2) and turn the hand, turning least.

    Newton's method, by least squares that ignore directions in which the arm hardly moves.
    """
    goal = _axes(joints)[..., 3] + by[..., 0] + 1j * by[..., 1]
    angle = joints.sum(axis=-1) + turn
    wanted = np.broadcast_to(joints, (*goal.shape, 4))
    jacobian, error = np.ones((*goal.shape, 3, 4)), np.empty((*goal.shape, 1, 3))
    for _ in range(3):  # leaves 0.1 mm of 100 mm in 9 poses of 10
        axes = _axes(wanted)
        # A joint's turning moves the wrist at right angles to the line between them.
        moves = 1j * (axes[..., 3:] - axes)
        jacobian[..., 0, :], jacobian[..., 1, :] = moves.real, moves.imag
        left = goal - axes[..., 3]
        error[..., 0, 0], error[..., 0, 1] = left.real, left.imag
        error[..., 0, 2] = angle - wanted.sum(axis=-1)
        across, strengths, along = np.linalg.svd(jacobian, full_matrices=False)
        weak = strengths < 0.02 * strengths[..., :1]
        shares = (error @ across)[..., 0, :] / np.where(weak, np.inf, strengths)
        wanted = wanted + (shares[..., None, :] @ along)[..., 0, :]
    return wanted


def _axes(joints: np.ndarray) -> np.ndarray:
    """Positions of the joints, (..., 4) -> (..., 4), x + z i."""
    ends = corners(direction_of(np.cumsum(joints[..., :3], axis=-1)))
    return np.concatenate([np.full((*ends.shape[:-1], 1), _BASE), ends], axis=-1)


def _joints(
    wrist: np.ndarray, hand: np.ndarray, bend: np.ndarray, elbow: float | np.ndarray
) -> np.ndarray:
    """All joints for wrist positions, hand angles and wrist joints, (...) each -> (..., 4), or NaN.

    The elbow, 1 or -1, is the side to which the shoulder turns.
    """
    lower = hand - bend
    middle = wrist - 1j * _LOWER * direction_of(lower) - _BASE
    cosine = (np.abs(middle) ** 2 - _UPPER**2 - _MIDDLE**2) / (2 * _UPPER * _MIDDLE)
    shoulder = elbow * np.arccos(np.where(np.abs(cosine) <= 1, cosine, np.nan))
    bent = _UPPER + _MIDDLE * direction_of(shoulder)
    joints = np.empty((*shoulder.shape, 4))
    root = np.arctan2(middle.imag, middle.real) - np.pi / 2 - np.arctan2(bent.imag, bent.real)
    joints[..., 0], joints[..., 1], joints[..., 3] = root, shoulder, bend
    joints[..., 2] = (lower - root - shoulder + np.pi) % (2 * np.pi) - np.pi
    return joints
