"""Proposals of the arm: straight joint paths with a grasp, turned into plans.

lifted = Proposal([pose], [CLOSED], 2)
plans = plans_of(now, [lifted, Proposal([], [OPEN])], knots=5)  # (2, 5, 5)
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from limberjack.planner.arm.kinematics import GRASP, direction, hand_poses_each, nudged

__all__ = ["Proposal", "approaches", "lifts", "plans_along", "plans_of"]

_APPROACH = 0.06, 0.03, 0.0  # metres before a grasp; where a hand passes that comes straight on


class Proposal(NamedTuple):
    """Straight joint paths from waypoint to waypoint.

    Attributes:
      waypoints: joints, (4,) each; without any the arm keeps still.
      grasp: the grasp's target at the knots; the last one holds.
      duration: knots from one waypoint to the next.
    """

    waypoints: Sequence[np.ndarray] | np.ndarray
    grasp: list[float]
    duration: int = 1


def plans_of(now: np.ndarray, proposals: Sequence[Proposal], knots: int) -> np.ndarray:
    """Targets of the arm and the grasp, (len(proposals), knots, 5).

    Args:
      now: the arm's joints at the first knot, (4,).
      proposals: the paths from there.
      knots: number of the spline's knots.
    """
    counts = np.array([len(proposal.waypoints) for proposal in proposals], int)[:, None]
    passed = np.empty((len(proposals), 1 + int(counts.max(initial=0)), 4))
    passed[:] = now
    targets = np.empty((len(proposals), knots, 5))
    for number, (waypoints, grasp, _) in enumerate(proposals):
        if len(waypoints):
            passed[number, 1 : 1 + len(waypoints)] = waypoints
        targets[number, :, 4] = (grasp + grasp[-1:] * knots)[:knots]
    durations = np.array([proposal.duration for proposal in proposals])[:, None]
    phases = np.minimum(np.arange(knots) / durations, counts)
    left, row = phases.astype(int), np.arange(len(proposals))[:, None]
    begin, end = passed[row, left], passed[row, np.minimum(left + 1, counts)]
    targets[..., :4] = (phases - left)[..., None] * (end - begin) + begin
    return targets


def plans_along(
    now: np.ndarray, waypoints: ArrayLike, knots: int, grasp: list[float], duration: int = 1
) -> np.ndarray:
    """The same for many proposals that differ in their waypoints only, (..., knots, 5).

    Args:
      now: the arm's joints at the first knot, (4,).
      waypoints: (..., n, 4); for an empty list the arm keeps still.
      knots: number of the spline's knots.
      grasp, duration: as in `Proposal`.
    """
    given = np.asarray(waypoints, float)
    if given.ndim == 1:
        given = given.reshape(0, 4)
    *several, count, _ = given.shape
    passed = np.concatenate([np.broadcast_to(now, (*several, 1, 4)), given], axis=-2)
    phases = np.minimum(np.arange(knots) / duration, count)
    left = phases.astype(int)
    begin, end = passed[..., left, :], passed[..., np.minimum(left + 1, count), :]
    targets = np.empty((*several, knots, 5))
    targets[..., :4] = (phases - left)[:, None] * (end - begin) + begin
    targets[..., 4] = (grasp + grasp[-1:] * knots)[:knots]
    return targets


def lifts(
    random: np.random.Generator, point: np.ndarray, angle: float, now: np.ndarray, press: float
) -> list[Proposal]:
    """Proposals that lift the hand from a position (2,) and an angle, with a grasp control."""
    above = point + np.array([[0.0, 0.04], [0.0, 0.12]])
    poses = np.concatenate(hand_poses_each(random, above, GRASP, now, 3, angle, 0.3))
    return [Proposal([pose], [press], slow) for pose in poses for slow in (1, 3)]


def approaches(poses: np.ndarray, ready: float, shut: float) -> list[Proposal]:
    """Proposals that bring the open hand straight on to poses, (n, 4), in which it closes."""
    if not len(poses):
        return []
    back = -np.array(_APPROACH)[:, None] * direction(poses.sum(axis=-1))[:, None]
    found: list[Proposal] = []
    for line in nudged(poses[:, None], back, 0.0):
        for first, slow in ((0, 1), (1, 1), (2, 1), (2, 2), (2, 3)):
            grasp = [ready] * (1 + slow * (len(line) - first)) + [shut]
            found.append(Proposal(line[first:], grasp, slow))
    return found
