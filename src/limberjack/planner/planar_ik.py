"""Inverse kinematics of the planar arm: joint angles that put the hand where it is wanted.

    joints = hand_poses(random, point=(0.2, 0.1), forward=0.065, now=qpos[:4], count=8)  # (n, 4)
    each = hand_poses_each(random, points, 0.065, qpos[:4], count=8)  # as many such arrays

Points are (x, z) in metres. Angles are measured as the joints': 0 points up, growing from x to -x
over the top. The arm has four joints for three numbers, so a pose leaves one free, which is drawn.
It knows the links' lengths, the joints' limits, the floor and the walls, and nothing of objects or
of the fingers, which may touch what they are to take.
"""

import itertools
from typing import Any

import numpy as np

__all__ = [
    "BASE_HEIGHT",
    "GRASP",
    "LENGTHS",
    "LIMITS",
    "PINCH",
    "WALL",
    "angle_of",
    "direction",
    "drawn_back",
    "hand_gap",
    "hand_height",
    "hand_places",
    "hand_poses",
    "hand_poses_each",
    "hand_route",
    "is_clear",
    "nudged",
]

# As in the suite's _planar_arm.xml; metres.
BASE_HEIGHT = 0.4
LENGTHS = _UPPER, _MIDDLE, _LOWER = 0.18, 0.15, 0.12
_BASE = BASE_HEIGHT * 1j  # x + z i
GRASP, PINCH = 0.065, 0.09  # from the wrist to the sites between the fingers
_PALM = 0.045  # from the wrist to the palm
_MOVES = 1j * np.array([*LENGTHS, _PALM])
# Limits of shoulder, elbow and wrist, less a margin in which the limits' springs push back.
LIMITS = np.radians([160.0, 160.0, 140.0]) - 0.05
_MOST_BENT = float(LIMITS[2])
_DRAWS, _FEWEST_DRAWS = 12, 72  # for each pose that is wanted, and for few of them
# Between a joint or the palm and floor or walls: about a link's radius. Fingers may touch them.
_CLEARANCE = np.array([0.021, 0.018, 0.016, 0.011])
_FINGERTIP = 0.096  # from the wrist to the tips of fingers that hold something
# Knuckles and fingertips, in the hand's frame.
_HAND = np.array([0.045j - 0.034, 0.045j + 0.034, 0.098j - 0.013, 0.098j + 0.013])
_BESIDE = 0.035  # between the middle of a link and of what is in the hand
_TIP_CLEARANCE = 0.006  # of their radius of 0.008; the contact gives way
WALL = 0.4  # the walls are the planes |x| = z + this
_SLOPE = np.sqrt(2)


def direction(angle: np.ndarray | float) -> np.ndarray:
    """The direction in which something at an angle points, (...) -> (..., 2)."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def angle_of(vector: np.ndarray) -> Any:
    """The angle at which vectors point, (..., 2) -> (...), radians."""
    return np.arctan2(-vector[..., 0], vector[..., 1])


def hand_places(joints: np.ndarray, forward: float, lateral: float = 0.0) -> np.ndarray:
    """Where a place of the hand is, for arm joints (..., 4) -> (..., 2)."""
    lengths = 1j * np.array([*LENGTHS, forward - 1j * lateral])
    place = _BASE + (_unit(np.cumsum(joints, axis=-1)) * lengths).sum(axis=-1)
    return np.stack([place.real, place.imag], axis=-1)


def hand_poses(
    random: np.random.Generator,
    point: np.ndarray,
    forward: float,
    now: np.ndarray,
    count: int,
    angle: float | None = None,
    tilt: float = np.pi,
    lateral: float = 0.0,
    width: float | None = None,
    slack: float = 0.0,
) -> np.ndarray:
    """Arm joints that bring a place of the hand to a point, (n, 4), n <= count.

    The first half are the nearest to the present joints; the others are drawn from what is left.
    Both halves are in the order of their distance.

    Args:
      random: draws the hand's angle and the redundancy.
      point: where to, (2,).
      forward: the place's distance from the wrist along the hand, such as `GRASP`.
      now: the present joints, (4,), from which solutions are near or far.
      count: how many at most.
      angle: the hand's angle; None for any.
      tilt: how far from it the hand may be.
      lateral: the place's distance from the hand's middle line.
      width: from that line to the fingertips, which then keep clear too; None: they need not.
      slack: how much further ahead in the hand the place may be.
    """
    points = np.reshape(point, (1, 2))
    wanted = angle, tilt, lateral, width, slack
    return hand_poses_each(random, points, forward, now, count, *wanted)[0]


def hand_poses_each(
    random: np.random.Generator,
    points: np.ndarray,
    forward: float | np.ndarray,
    now: np.ndarray,
    count: int,
    angle: float | np.ndarray | None = None,
    tilt: float | np.ndarray = np.pi,
    lateral: float | np.ndarray = 0.0,
    width: float | None = None,
    slack: float = 0.0,
) -> list[np.ndarray]:
    """What `hand_poses` finds for each of several points, (n, 4) each, in one go.

    Args:
      random, count, width, slack: as there, for all points.
      points: where to, (R, 2).
      forward, angle, tilt, lateral: as there, for all points or (R,).
      now: the present joints, for all points or (R, 4).
    """
    rows, draws = len(points), max(_DRAWS * count, _FEWEST_DRAWS)
    if not rows:
        return []
    tilt, forward = _of_each(tilt), _of_each(forward)
    pointing_to = _of_each(0.0 if angle is None else angle)
    hand = tilt * random.uniform(-1.0, 1.0, (rows, draws)) + pointing_to
    bend = random.uniform(-_MOST_BENT, _MOST_BENT, (rows, draws))
    ahead = forward + slack * random.uniform(0.0, 1.0, (rows, draws))
    place = (points[:, 0] + 1j * points[:, 1])[:, None]
    wrist = place - _unit(hand) * (1j * ahead + _of_each(lateral))
    elbows = np.array([[[1.0], [-1.0]]])
    usable = _joints(wrist[:, None], hand[:, None], bend[:, None], elbows).reshape(rows, -1, 4)
    row, column = _is_possible(usable).nonzero()
    usable, start = usable[row, column], now if np.ndim(now) == 1 else now[row]
    usable[:, 0] += 2 * np.pi * np.round((start[..., 0] - usable[:, 0]) / (2 * np.pi))
    pointing = _unit(usable.cumsum(axis=-1))
    clear = _is_clear(pointing)
    if width is not None:
        clear &= _has_room(pointing, width)
    usable, far = usable[clear], np.abs(usable - start).max(axis=-1)[clear]
    if rows == 1:
        return [usable[_chosen(random, far, count)]]
    ends = row[clear].searchsorted(np.arange(rows + 1))
    return [
        usable[b:e][_chosen(random, far[b:e], count)] for b, e in itertools.pairwise(ends.tolist())
    ]


def _of_each(values: Any) -> Any:
    """A number for all points as it is, one for each of them as a column."""
    return values[:, None] if np.ndim(values) else values


def _chosen(random: np.random.Generator, far: np.ndarray, count: int) -> np.ndarray:
    """Which poses are kept that are so far, (n,): the nearest, and others that are drawn."""
    nearest = np.argsort(far, kind="stable")
    near, others = nearest[: (count + 1) // 2], nearest[(count + 1) // 2 :]
    # Others too, because the way to the nearest may be blocked.
    drawn = np.sort(random.permutation(len(others))[: count // 2])
    return np.concatenate([near, others[drawn]])


def hand_route(
    now: np.ndarray,
    pose: np.ndarray,
    points: np.ndarray,
    parts: np.ndarray,
    forward: float,
    lateral: float = 0.0,
) -> np.ndarray:
    """Arm joints that bring a place of the hand to points one after the other, (..., n, 4).

    NaN where the arm cannot reach, and everywhere for an elbow that would have to turn over.

    Args:
      now: the joints at the start, (..., 4).
      pose: those at the end, (..., 4).
      points: where to, (..., n, 2).
      parts: of the way from `now` to `pose`, 0 to 1, (..., n), for the hand's angle and its wrist.
      forward, lateral: the place in the hand, as for `hand_poses`.
    """
    now, pose = now[..., None, :], pose[..., None, :]  # the same for all points of a way
    angle = now.sum(axis=-1)
    hand = angle + parts * (pose.sum(axis=-1) - angle)
    bend = now[..., 3] + parts * (pose[..., 3] - now[..., 3])
    wrist = points[..., 0] + 1j * points[..., 1] - _unit(hand) * (1j * forward + lateral)
    elbow = np.where(now[..., 1] * pose[..., 1] < 0, np.nan, np.sign(pose[..., 1]))
    joints = _joints(wrist, hand, bend, elbow)
    # The root turns without jumps.
    turns = np.diff(joints[..., 0], prepend=np.broadcast_to(now[..., 0], (*joints.shape[:-2], 1)))
    joints[..., 0] -= 2 * np.pi * np.round(turns / (2 * np.pi)).cumsum(axis=-1)
    return joints


def drawn_back(poses: np.ndarray, by: float) -> np.ndarray:
    """The joints with the hand so far back along itself, the wrist as it is, (n, 4) -> (n, 4).

    NaN where the arm, with its elbow on the same side, does not get there.

    Args:
      poses: the joints before.
      by: metres.
    """
    hand = poses.sum(axis=-1)
    wrist = _corners(poses)[:, 3] - by * 1j * _unit(hand)
    found = _joints(wrist, hand, poses[:, 3], np.sign(poses[:, 1]))
    found[:, 0] += 2 * np.pi * np.round((poses[:, 0] - found[:, 0]) / (2 * np.pi))
    clear = _is_possible(found) & _is_clear(_unit(found.cumsum(axis=-1)))
    found[~clear] = np.nan
    return found


def nudged(joints: np.ndarray, by: np.ndarray, turn: np.ndarray | float) -> np.ndarray:
    """The joints (..., 4) that move the wrist by (..., 2) metres and turn the hand, turning least.

    Args:
      joints: the arm's.
      by: metres, (..., 2).
      turn: radians, (...).
    """
    goal = _corners(joints)[..., 3] + by[..., 0] + 1j * by[..., 1]
    angle = joints.sum(axis=-1) + turn
    wanted = np.broadcast_to(joints, (*goal.shape, 4))
    jacobian, error = np.ones((*goal.shape, 3, 4)), np.empty((*goal.shape, 1, 3))
    for _ in range(3):  # a tenth of a millimetre is left of 10 centimetres then, in 9 poses of 10
        corners = _corners(wanted)
        # A joint's turning moves the wrist at right angles to the line between them.
        moves = 1j * (corners[..., 3:] - corners)
        jacobian[..., 0, :], jacobian[..., 1, :] = moves.real, moves.imag
        left = goal - corners[..., 3]
        error[..., 0, 0], error[..., 0, 1] = left.real, left.imag
        error[..., 0, 2] = angle - wanted.sum(axis=-1)
        # Least squares, that leave directions alone in which the arm hardly moves.
        across, strengths, along = np.linalg.svd(jacobian, full_matrices=False)
        weak = strengths < 0.02 * strengths[..., :1]
        shares = (error @ across)[..., 0, :] / np.where(weak, np.inf, strengths)
        wanted = wanted + (shares[..., None, :] @ along)[..., 0, :]
    return wanted


def _corners(joints: np.ndarray) -> np.ndarray:
    """Base, shoulder, elbow and wrist, (..., 4) -> (..., 4), x + z i."""
    pointing = 1j * _unit(np.cumsum(joints[..., :3], axis=-1))
    links = np.cumsum(pointing * LENGTHS, axis=-1)
    return _BASE + np.concatenate([np.zeros((*links.shape[:-1], 1)), links], axis=-1)


def is_clear(joints: np.ndarray, reach: float) -> np.ndarray:
    """Whether the arm is clear of floor, walls and itself, within its limits, (..., 4) -> (...).

    Args:
      joints: the arm's.
      reach: from the wrist to the far end of what is in the hand, metres.
    """
    pointing = _unit(np.cumsum(joints, axis=-1))
    clear = _is_possible(joints) & _is_clear(pointing) & _has_room(pointing, 0.0, reach)
    return clear & _is_unfolded(pointing, reach)


def hand_height(joints: np.ndarray) -> np.ndarray:
    """How far above floor and walls the middle of a hand's lowest part is, (..., 4) -> (...)."""
    return _height(_hand_points(joints)).min(axis=-1)


def hand_gap(joints: np.ndarray, line: np.ndarray) -> np.ndarray:
    """How far the middles of a hand's parts are from a line with two ends, (..., 4) -> (...)."""
    start, end = line[:, 0] + 1j * line[:, 1]
    along = (_hand_points(joints) - start) / (end - start)
    return np.abs((along - np.clip(along.real, 0.0, 1.0)) * (end - start)).min(axis=-1)


def _hand_points(joints: np.ndarray) -> np.ndarray:
    """Knuckles and fingertips around something narrow, (..., 4) -> (..., 4), x + z i."""
    pointing = _unit(np.cumsum(joints, axis=-1))
    wrist = _BASE + (1j * pointing[..., :3] * LENGTHS).sum(axis=-1, keepdims=True)
    return wrist + pointing[..., 3:] * _HAND


def _unit(angles: Any) -> np.ndarray:
    """The directions of angles, as complex numbers of length 1."""
    return np.exp(1j * angles)


def _joints(
    wrist: np.ndarray, hand: np.ndarray, bend: np.ndarray, elbow: float | np.ndarray
) -> np.ndarray:
    """All joints for wrist places, hand angles and wrist joints, (...) each -> (..., 4), or NaN.

    The elbow says to which side the shoulder turns, 1 or -1.
    """
    lower = hand - bend
    middle = wrist - 1j * _LOWER * _unit(lower) - _BASE
    cosine = (np.abs(middle) ** 2 - _UPPER**2 - _MIDDLE**2) / (2 * _UPPER * _MIDDLE)
    shoulder = elbow * np.arccos(np.where(np.abs(cosine) <= 1, cosine, np.nan))
    bent = _UPPER + _MIDDLE * _unit(shoulder)
    joints = np.empty((*shoulder.shape, 4))
    root = np.arctan2(middle.imag, middle.real) - np.pi / 2 - np.arctan2(bent.imag, bent.real)
    joints[..., 0], joints[..., 1], joints[..., 3] = root, shoulder, bend
    joints[..., 2] = (lower - root - shoulder + np.pi) % (2 * np.pi) - np.pi
    return joints


def _is_possible(joints: np.ndarray) -> np.ndarray:
    """Whether there is a solution, within the limits, (..., 4) -> (...)."""
    within = np.abs(joints[..., 1:]) <= LIMITS  # False for NaN
    return within[..., 0] & within[..., 1] & within[..., 2]


# In what follows, links point where (..., 4) complex numbers of length 1 times i do.


def _is_clear(pointing: np.ndarray) -> np.ndarray:
    """Whether the arm keeps clear of floor and walls, (...)."""
    # From the base over the links' ends to the palm.
    points = _BASE + np.cumsum(pointing * _MOVES, axis=-1)
    return np.all(_height(points) > _CLEARANCE, axis=-1)


def _has_room(pointing: np.ndarray, width: float, reach: float = _FINGERTIP) -> np.ndarray:
    """Whether places this far from the hand's middle line and the wrist keep clear, (...)."""
    lengths = 1j * np.array([*LENGTHS, reach])
    ends = _BASE + (pointing * lengths).sum(axis=-1, keepdims=True)
    tips = ends + pointing[..., 3:] * width * np.array([-1.0, 1.0])
    return np.all(_height(tips) > _TIP_CLEARANCE, axis=-1)


def _is_unfolded(pointing: np.ndarray, reach: float) -> np.ndarray:
    """Whether what is in the hand, and the links, keep clear of earlier links, (...)."""
    links = 1j * pointing
    ends = np.cumsum(links[..., :3] * LENGTHS, axis=-1)  # from the base
    held = ends[..., 2:] + links[..., 3:] * reach * np.array([0.2, 0.4, 0.6, 0.8, 1.0])
    lower = ends[..., 1:2] + links[..., 2:3] * _LOWER * np.array([0.4, 0.7])
    starts = ends[..., :2] - links[..., :2] * LENGTHS[:2]
    clear = np.ones(pointing.shape[:-1], bool)
    for link, points in ((0, held), (0, lower), (1, held)):
        along = (points - starts[..., link, None]) / links[..., link, None]
        along.real -= np.clip(along.real, 0.0, LENGTHS[link])
        clear &= np.all(np.abs(along) > _BESIDE, axis=-1)
    return clear


def _height(points: np.ndarray) -> np.ndarray:
    """Distance from the floor or the nearest wall, (...) complex -> (...)."""
    above = np.imag(points)
    wall = (above + WALL - np.abs(np.real(points))) / _SLOPE
    return np.minimum(above, wall)
