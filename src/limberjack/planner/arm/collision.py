"""The collision model of the arm: its distances from obstacles, floor, walls and itself.

    gaps = clearance(poses, held=0.085, obstacle=Obstacle(ends, radii))  # (n, 4), metres
    is_clear(poses, reach=0.178)                                         # (n,)

Links, hand, palms, straight fingers and a held object are capsules with the model's lengths and
radii. `clearance` measures capsules against capsules, for paths around obstacles. `is_clear` and
`is_off_ground` test a few points of the same links, which is a tenth of the work, for the thousands
of poses that inverse kinematics draws.

In this module positions are complex numbers, x + z i, in metres. Links are directions: complex
numbers of length 1 which times i point along a link.
"""

from typing import NamedTuple

import numpy as np

from limberjack.planner.arm.geometry import GEOMETRY

__all__ = [
    "LIMITS",
    "NOTHING",
    "Obstacle",
    "clearance",
    "corners",
    "direction_of",
    "hand_gap",
    "hand_height",
    "has_room",
    "is_clear",
    "is_off_ground",
    "within_limits",
]

# Limits of shoulder, elbow and wrist, less a margin in which the limits' springs push back.
LIMITS = np.array(GEOMETRY.limits) - 0.05
_BASE, _LENGTHS = GEOMETRY.base_height * 1j, np.array(GEOMETRY.lengths)
_KNUCKLE = GEOMETRY.knuckle[1]  # metres ahead of the wrist


def _hand() -> tuple[np.ndarray, np.ndarray]:
    """Parts in the hand's frame, aside + ahead i, metres.

    Returns both ends of hand, palms and fingers, (2, 5), and knuckles and fingertips, (4,).
    """
    # The fingers' axes are beside the knuckles, where they enclose opened and closed fingers.
    aside = np.array([-1.0, 1.0]) * (GEOMETRY.knuckle[0] + 0.004)
    tip = (_KNUCKLE + GEOMETRY.finger[0]) * 1j
    end, knuckles, tips = GEOMETRY.hand * 1j, _KNUCKLE * 1j + aside, tip + aside
    lines = np.array([[0.0j, end, end, *knuckles], [end, *knuckles, *tips]])
    return lines, np.append(knuckles, tip + np.array([-0.013, 0.013]))  # around a peg


_HAND, _HAND_POINTS = _hand()
# Of two links, lower arm, hand, palms, fingers and a held object.
_RADII = np.array([*GEOMETRY.radii[:-1], 0.01, 0.01, GEOMETRY.radii[-1]])
# Pairs of these capsules that keep clear of each other.
_PAIRS = np.array([[0, 0, 0, 0, 0, 1, 1, 1, 1], [2, 3, 6, 7, 8, 3, 6, 7, 8]])


class Obstacle(NamedTuple):
    """Thick lines: ends (m, 2, 2) and radii (m,), metres."""

    ends: np.ndarray
    radii: np.ndarray


NOTHING = Obstacle(np.zeros((0, 2, 2)), np.zeros(0))


def clearance(poses: np.ndarray, held: float, obstacle: Obstacle) -> np.ndarray:
    """Distances of poses (n, 4) from the obstacle, themselves, and the ground, (n, 4), metres.

    The columns are: from the obstacle, from the arm itself, of the links from floor and walls, and
    of hand and fingers from floor and walls. An object is held up to so far from the wrist.
    """
    lines = _lines(poses, held)
    parts, others = lines.shape[-1], len(obstacle.ends)
    ends = (obstacle.ends[..., 0] + 1j * obstacle.ends[..., 1]).T[:, None]
    beside = np.broadcast_to(np.tile(ends, parts), (2, len(poses), parts * others))
    # Each part beside each of the obstacle's lines, then the arm's parts beside each other.
    first = np.concatenate([lines.repeat(others, axis=-1), lines[..., _PAIRS[0]]], axis=-1)
    second = np.concatenate([beside, lines[..., _PAIRS[1]]], axis=-1)
    radii = (_RADII[:, None] + obstacle.radii).ravel(), _RADII[_PAIRS].sum(axis=0)
    gaps = _gaps(first, second) - np.concatenate(radii)
    ground = _height(lines[..., 1:]).min(axis=0) - _RADII[1:]
    around = gaps[:, : parts * others].min(axis=1, initial=np.inf)  # there may be no obstacle
    arm = gaps[:, parts * others :].min(axis=1)
    return np.stack([around, arm, ground[:, :3].min(axis=1), ground[:, 3:].min(axis=1)], axis=1)


def is_clear(joints: np.ndarray, reach: float) -> np.ndarray:
    """Whether the arm is clear of floor, walls and itself, within its limits, (..., 4) -> (...).

    The far end of a held object is so far from the wrist.
    """
    pointing = direction_of(np.cumsum(joints, axis=-1))
    clear = within_limits(joints) & is_off_ground(pointing) & has_room(pointing, 0.0, reach)
    return clear & _is_unfolded(pointing, reach)


def hand_height(joints: np.ndarray) -> np.ndarray:
    """Height of the lowest part of the hand above floor and walls, (..., 4) -> (...), metres."""
    return _height(_hand_points(joints)).min(axis=-1)


def hand_gap(joints: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Distance of the hand's parts from a line with two ends, (..., 4) -> (...), metres."""
    start, end = line[:, 0] + 1j * line[:, 1]
    along = (_hand_points(joints) - start) / (end - start)
    return np.abs((along - np.clip(along.real, 0.0, 1.0)) * (end - start)).min(axis=-1)


def _hand_points(joints: np.ndarray) -> np.ndarray:
    """Knuckles and fingertips around something narrow, (..., 4) -> (..., 4), x + z i."""
    pointing = direction_of(np.cumsum(joints, axis=-1))
    return corners(pointing)[..., 2:] + pointing[..., 3:] * _HAND_POINTS


def within_limits(joints: np.ndarray) -> np.ndarray:
    """Whether joints are finite and within their limits, (..., 4) -> (...)."""
    within = np.abs(joints[..., 1:]) <= LIMITS  # False for NaN
    return within[..., 0] & within[..., 1] & within[..., 2]


def direction_of(angles: np.ndarray) -> np.ndarray:
    """The directions of angles, as complex numbers of length 1."""
    return np.exp(1j * angles)


def corners(pointing: np.ndarray) -> np.ndarray:
    """Shoulder, elbow and wrist of links in these directions, (..., 3 or 4) -> (..., 3)."""
    return _BASE + (1j * pointing[..., :3] * _LENGTHS).cumsum(axis=-1)


def is_off_ground(pointing: np.ndarray) -> np.ndarray:
    """Whether the arm keeps clear of floor and walls, (...)."""
    # From the base over the links' ends to the palm, with a margin beyond their radii.
    points = _BASE + np.cumsum(pointing * (1j * np.array([*_LENGTHS, _KNUCKLE])), axis=-1)
    least = np.add(GEOMETRY.radii[:4], [0.001, 0.001, 0.002, 0.0])
    return np.all(_height(points) > least, axis=-1)


def has_room(pointing: np.ndarray, width: float, reach: float = 0.096) -> np.ndarray:
    """Whether points this far from the hand's middle line and the wrist keep clear, (...).

    By default these are the tips of fingers that hold something. They may sink into the ground by
    2 mm of their radius of 8: the contact gives way.
    """
    lengths = 1j * np.array([*_LENGTHS, reach])
    ends = _BASE + (pointing * lengths).sum(axis=-1, keepdims=True)
    tips = ends + pointing[..., 3:] * width * np.array([-1.0, 1.0])
    return np.all(_height(tips) > 0.006, axis=-1)


def _is_unfolded(pointing: np.ndarray, reach: float) -> np.ndarray:
    """Whether points of a held object and the lower arm are 35 mm off earlier links, (...)."""
    links = 1j * pointing
    ends = np.cumsum(links[..., :3] * _LENGTHS, axis=-1)  # from the base
    held = ends[..., 2:] + links[..., 3:] * reach * np.array([0.2, 0.4, 0.6, 0.8, 1.0])
    lower = ends[..., 1:2] + links[..., 2:3] * _LENGTHS[2] * np.array([0.4, 0.7])
    starts = ends[..., :2] - links[..., :2] * _LENGTHS[:2]
    clear = np.ones(pointing.shape[:-1], bool)
    for link, points in ((0, held), (0, lower), (1, held)):
        along = (points - starts[..., link, None]) / links[..., link, None]
        along.real -= np.clip(along.real, 0.0, _LENGTHS[link])
        clear &= np.all(np.abs(along) > 0.035, axis=-1)
    return clear


def _height(points: np.ndarray) -> np.ndarray:
    """Distance from the floor or the nearest wall at 45 degrees, (...) complex -> (...)."""
    above = np.imag(points)
    return np.minimum(above, (above + GEOMETRY.floor - np.abs(np.real(points))) / np.sqrt(2))


def _lines(poses: np.ndarray, held: float) -> np.ndarray:
    """Both ends of the axes of links, hand, fingers and a held object, (2, n, 9)."""
    pointing = direction_of(poses.cumsum(axis=-1))
    joints = corners(pointing)
    lines: np.ndarray = np.empty((2, len(poses), 3 + _HAND.shape[1] + 1), complex)
    lines[0, :, 0], lines[0, :, 1:3], lines[1, :, :3] = _BASE, joints[:, :2], joints
    lines[..., 3:-1] = joints[:, 2:] + _HAND[:, None] * pointing[:, 3:]
    lines[..., -1] = joints[:, 2] + np.array([[GEOMETRY.grasp], [held]]) * 1j * pointing[:, 3]
    return lines


def _gaps(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances between lines, both (2, ...) of ends -> (...); 0 where they cross.

    Where lines do not cross, one of the four ends is nearest to the other line.
    """
    # From the start of a line to the ends of the other one.
    to: np.ndarray = np.empty((4, *first.shape[1:]), complex)
    along = np.empty_like(to)
    np.subtract(first, second[0], out=to[:2])
    np.subtract(second, first[0], out=to[2:])
    along[:2], along[2:] = second[1] - second[0], first[1] - first[0]
    turned = to * along.conj()
    side = np.imag(turned)
    crossing = (side[0] * side[1] < 0) & (side[2] * side[3] < 0)
    part = np.real(turned) / _squared(along)
    off = to - np.minimum(np.maximum(part, 0.0), 1.0) * along
    gaps = np.sqrt(_squared(off).min(axis=0))
    gaps[crossing] = 0.0
    return gaps


def _squared(vectors: np.ndarray) -> np.ndarray:
    """The squares of complex numbers' lengths."""
    return np.real(vectors) ** 2 + np.imag(vectors) ** 2
