"""Proposals of the arm: straight joint paths with a grasp, turned into plans.

lifted = Proposal([pose], [CLOSED], 2)
plans = plans_of(now, [lifted, Proposal([], [OPEN])], knots=5)  # (2, 5, 5)
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.hand import ARM, PLANE
from limberjack.planner.arm.kinematics import GRASP, direction, hand_poses_each, nudged
from limberjack.planner.arm.path import Path

__all__ = ["Proposal", "approaches", "lifts", "plans_along", "plans_of", "plans_on", "straight_to"]


class Proposal(NamedTuple):
    """Straight joint paths from waypoint to waypoint."""

    waypoints: Sequence[np.ndarray] | np.ndarray  # (4,) each; without any the arm keeps still
    grasp: list[float]  # the grasp's target at the knots; the last one holds
    duration: int = 1  # knots from one waypoint to the next


def plans_of(now: np.ndarray, proposals: Sequence[Proposal], knots: int) -> np.ndarray:
    """Targets of the arm, at joints `now` at the first knot, and the grasp, (n, knots, 5)."""
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
    """The same for proposals that differ in their waypoints (..., n, 4) only, (..., knots, 5)."""
    given = np.asarray(waypoints, float)
    *several, count, _ = given.shape if given.ndim > 1 else (0, 4)  # an empty list of waypoints
    paths = given.reshape(int(np.prod(several)), count, 4)
    proposals = [Proposal(path, grasp, duration) for path in paths]
    return plans_of(now, proposals, knots).reshape(*several, knots, 5)


def plans_on(path: Path, now: np.ndarray, grasp: float, knots: int) -> np.ndarray:
    """Targets along a path at several speeds, with a grasp, (n, knots, 5)."""
    strides = 2, 4, 7, 12, 18, 26  # points of the path from one knot to the next
    ahead = [path.next_points(stride)[:knots] for stride in strides]
    return plans_of(now, [Proposal(points, [grasp]) for points in ahead], knots)


def lifts(random: np.random.Generator, data: NamedFields, press: float) -> list[Proposal]:
    """Proposals that lift the hand of a single simulation with a grasp's target."""
    now = data.qpos[ARM]
    above = data.site_xpos["grasp"][PLANE] + np.array([[0.0, 0.04], [0.0, 0.12]])
    angle = float(now.sum())
    poses = np.concatenate(hand_poses_each(random, above, GRASP, now, 3, angle, 0.3))
    return straight_to(poses, press, 1, 3)


def straight_to(poses: Iterable[np.ndarray], grasp: float, *durations: int) -> list[Proposal]:
    """Proposals straight to each of the poses, (4,), in so many knots, with a grasp's target."""
    return [Proposal([pose], [grasp], slow) for pose in poses for slow in durations]


def approaches(poses: np.ndarray, ready: float, shut: float) -> list[Proposal]:
    """Proposals that bring the open hand straight on to poses, (n, 4), in which it closes."""
    if not len(poses):
        return []
    before = np.array([0.06, 0.03, 0.0])  # metres
    back = -before[:, None] * direction(poses.sum(axis=-1))[:, None]
    found: list[Proposal] = []
    for line in nudged(poses[:, None], back, 0.0):
        for first, slow in ((0, 1), (1, 1), (2, 1), (2, 2), (2, 3)):
            grasp = [ready] * (1 + slow * (len(line) - first)) + [shut]
            found.append(Proposal(line[first:], grasp, slow))
    return found
