"""Inverse kinematics of the planar arm: joint angles that put the hand where it is wanted.

    joints = hand_poses(random, point=(0.2, 0.1), forward=0.065, now=qpos[:4], count=8)  # (n, 4)

Points are (x, z) in metres. Angles are measured as the joints': 0 points up, growing from x to -x
over the top. The arm has four joints for three numbers, so a pose leaves one free, which is drawn.
It knows the links' lengths, the joints' limits, the floor and the walls, and nothing of objects or
of the fingers, which may touch what they are to take.
"""

from collections.abc import Sequence

import numpy as np

__all__ = ["GRASP", "PINCH", "angle_of", "direction", "hand_poses"]

# As in the suite's _planar_arm.xml; metres.
_BASE = 0.4j  # x + z i
_UPPER, _MIDDLE, _LOWER = 0.18, 0.15, 0.12
GRASP, PINCH = 0.065, 0.09  # from the wrist to the sites between the fingers
_PALM = 0.045  # from the wrist to the palm
# Limits of shoulder, elbow and wrist, less a margin in which the limits' springs push back.
_LIMITS = np.radians([160.0, 160.0, 140.0]) - 0.05
# Between a joint or the palm and floor or walls: about a link's radius. Fingers may touch them.
_CLEARANCE = np.array([0.021, 0.018, 0.016, 0.011])
_WALL = 0.4  # the walls are the planes |x| = z + this


def direction(angle: np.ndarray | float) -> np.ndarray:
    """The direction in which something at an angle points, (...) -> (..., 2)."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def angle_of(vector: np.ndarray) -> float:
    """The angle at which a vector (2,) points, radians."""
    return float(np.arctan2(-vector[0], vector[1]))


def hand_poses(
    random: np.random.Generator,
    point: np.ndarray,
    forward: float,
    now: np.ndarray,
    count: int,
    angle: float | None = None,
    tilt: float = np.pi,
    lateral: float = 0.0,
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
    """
    draws = 24 * max(count, 1)
    hand = (0.0 if angle is None else angle) + random.uniform(-tilt, tilt, draws)
    bend = random.uniform(-_LIMITS[2], _LIMITS[2], draws)
    place = complex(*point)
    wrist = place - np.exp(1j * hand) * (1j * forward + lateral)
    solutions = _two_link(wrist, hand, bend)
    solutions[:, 0] += 2 * np.pi * np.round((now[0] - solutions[:, 0]) / (2 * np.pi))
    usable = solutions[_is_possible(solutions) & _is_clear(solutions)]
    nearest = np.argsort(np.abs(usable - now).max(axis=-1), kind="stable")
    near, others = nearest[: (count + 1) // 2], nearest[(count + 1) // 2 :]
    # Others too, because the way to the nearest may be blocked.
    drawn = np.sort(random.permutation(len(others))[: count // 2])
    return usable[np.concatenate([near, others[drawn]])]


def _two_link(wrist: np.ndarray, hand: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """All joints for wrist places, hand angles and wrist joints: (n,) each -> (2n, 4), or NaN."""
    lower = hand - bend
    elbow = wrist - 1j * _LOWER * np.exp(1j * lower) - _BASE
    cosine = (np.abs(elbow) ** 2 - _UPPER**2 - _MIDDLE**2) / (2 * _UPPER * _MIDDLE)
    bent = np.arccos(np.where(np.abs(cosine) <= 1, cosine, np.nan))
    solutions: list[np.ndarray] = []
    for shoulder in (bent, -bent):
        root = np.angle(elbow) - np.pi / 2 - np.angle(_UPPER + _MIDDLE * np.exp(1j * shoulder))
        third = lower - root - shoulder
        third = (third + np.pi) % (2 * np.pi) - np.pi
        solutions.append(np.stack([root, shoulder, third, bend], axis=-1))
    return np.concatenate(solutions)


def _is_possible(joints: np.ndarray) -> np.ndarray:
    """Whether there is a solution, within the limits, (n, 4) -> (n,)."""
    return np.all(np.abs(joints[:, 1:]) <= _LIMITS, axis=-1)  # False for NaN


def _is_clear(joints: np.ndarray) -> np.ndarray:
    """Whether the arm keeps clear of floor and walls, (n, 4) -> (n,)."""
    pointing = np.exp(1j * np.cumsum(joints, axis=-1))
    ahead: Sequence[float] = (_UPPER, _MIDDLE, _LOWER)
    corners: np.ndarray = _BASE + np.cumsum(1j * pointing[:, :3] * np.array(ahead), axis=-1)
    hand = pointing[:, 3:]
    points = np.concatenate([corners, corners[:, 2:] + 1j * _PALM * hand], axis=-1)
    wall = (points.imag + _WALL - np.abs(points.real)) / np.sqrt(2)
    return np.all(np.minimum(points.imag, wall) > _CLEARANCE, axis=-1)
