"""`PegPaths`: the arm's paths to a peg that lies still and, once it is held, to the target.

    paths = PegPaths()
    paths.look_for_target(random, now, find_goals)
    cost = proposals.cost_to_target(joints, near_cost)

Far from the end of a path its remaining length costs; near the end, the positions of hand and peg.
These alone are not enough: a peg near the target, or a hand near the peg, would never turn round.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from limberjack.planner.arm.collision import hand_height
from limberjack.planner.arm.hand import OPEN_ANGLE, PLANE, TIPS
from limberjack.planner.arm.kinematics import angle_of, direction, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, plans_of
from limberjack.planner.manipulator.detours import find_detours, keep_clear
from limberjack.planner.manipulator.grips import BACK, HANDLE, Pose, downwards, in_world
from limberjack.utils import arrays

__all__ = ["PegPaths", "across", "grasp_of", "opening"]

_LENGTH = 0.113  # metres, of a peg
_HAND, _HAND_AND_PEG = 0.1, 0.178  # metres; from the wrist to the end
_STEEP, _SUNK = 0.25, 0.003  # radians, metres; how the hand comes to a peg that lies flat
_PINCHED = 0.0, 0.034  # metres in the frame of a peg; where the hand pinches it
_BEFORE = 0.07  # metres; how far from where it takes a peg the hand is clear of it
_DEEP = -0.012  # metres; a guard that is behind the fingertips keeps a peg in the hand
_CLEAR = 0.04  # metres; how far fingertips keep from a peg that they are not around
_LIFTED = 0.035  # metres; so high a hand is lifted that holds a peg before it goes on its path
_MOVED = 0.01  # metres, or of a frame; more changes the paths to a peg
_GOALS = 8  # poses in which a peg may fall
_LOOKS = 2  # plannings; so often better paths are looked for
_STRIDES = 0.3, 1.0, 3.0  # radians of a path from one knot to the next

_Goals = Callable[[np.random.Generator], np.ndarray]  # draws joints, (n, 4)


class _Toll(NamedTuple):
    """Cost of a path.

    Attributes:
      near: radians from its end within which hand or peg count, and not at twice that.
      per_radian: for what is left of it.
      besides: for not being near.
    """

    near: float
    per_radian: float
    besides: float


_TO_PEG, _TO_TARGET = _Toll(0.3, 1.0, 1.0), _Toll(0.4, 1.2, 2.0)


class PegPaths:
    """Paths that are kept as long as they are clear, so that the arm keeps to one of them."""

    def __init__(self) -> None:
        """Knows no path yet."""
        self._to_peg: list[Path] = []  # to before a peg, and on to it
        self._to_target: list[Path] = []
        self._goals = np.zeros((0, 4))  # joints that have a held peg at the target
        self._before = np.zeros((0, 2, 4))  # joints that have the hand before a peg, and at it
        self._lay = np.zeros(12)  # the peg's pose for which these are
        self._looked = 0  # plannings since better paths were looked for

    def forget(self) -> None:
        """Forgets all paths, as for a peg that moves or is out of reach."""
        self._to_peg, self._to_target = [], []

    def look_for_target(
        self, random: np.random.Generator, now: np.ndarray, up: np.ndarray, find: _Goals
    ) -> bool:
        """Looks for better paths to the target than those that are known, for a peg in the hand.

        Returns whether there is one.

        Args:
          random: draws them.
          now: the arm's joints, (4,).
          up: away from the ground, (2,).
          find: finds those that have the peg at the target.
        """
        self._to_peg = []
        if not self._to_target:  # none yet, or all of these are blocked
            self._goals = find(random)
        lift = _LIFTED - float(hand_height(now))
        first = nudged(now, lift * up, 0.0) if lift > 0 else None
        goals, known = self._goals[:, None], self._to_target
        self._to_target = self._kept(now, known, _HAND_AND_PEG, None, first) or find_detours(
            random, now, goals, _HAND_AND_PEG, known=known, first=first
        )
        return len(self._to_target) > 0

    def _kept(
        self,
        now: np.ndarray,
        known: list[Path],
        reach: float,
        around: np.ndarray | None = None,
        first: np.ndarray | None = None,
    ) -> list[Path]:
        """Known paths as seen from now on, none if it is time to look for better ones."""
        self._looked += 1
        if self._looked < _LOOKS:
            return keep_clear(now, known, reach, around, first)
        self._looked = 0
        return []

    def look_for_peg(
        self, random: np.random.Generator, now: np.ndarray, peg: Pose, find: _Goals
    ) -> None:
        """Looks for better paths to a peg than those that are known, that do not go across it.

        Args:
          random: draws them.
          now: the arm's joints, (4,).
          peg: its pose.
          find: finds the arm's joints that have the hand around it.
        """
        self._to_target = []
        pose = np.concatenate(peg)
        if not self._to_peg or np.abs(pose - self._lay).max() > _MOVED:
            self._lay, poses = pose, find(random)
            self._looked = _LOOKS  # the paths that are known lead elsewhere
            back = nudged(poses, -_BEFORE * direction(poses.sum(axis=-1)), 0.0)
            self._before = np.stack([back, poses], axis=1)
        place, frame = peg
        line = np.stack([place + in_world(frame, HANDLE.place), place - 0.05 * frame[2::3]])
        known, around = self._to_peg, line[:, PLANE]
        self._to_peg = self._kept(now, known, _HAND, around) or find_detours(
            random, now, self._before, _HAND, known=known, around=around
        )

    def look_for_room(
        self, random: np.random.Generator, now: np.ndarray, widest: np.ndarray
    ) -> None:
        """Looks for paths to where a peg falls that lies on the arm.

        Args:
          random: draws them.
          now: the arm's joints, (4,).
          widest: how far from 0 the joints may be there, (4,), radians.
        """
        self._to_target = []
        goals = np.random.default_rng(0).uniform(-widest, widest, (_GOALS, 1, 4))
        self._to_peg = find_detours(random, now, goals, _HAND, known=self._to_peg)

    def cost_to_peg(self, joints: np.ndarray, near_cost: np.ndarray) -> np.ndarray:
        """Cost of the rest of the path to the peg and, at its end, of the hand, (N,)."""
        return _cost(self._to_peg, _TO_PEG, joints, near_cost)

    def cost_to_target(self, joints: np.ndarray, near_cost: np.ndarray) -> np.ndarray:
        """Cost of the rest of the path to the target and, at its end, of the peg, (N,)."""
        return _cost(self._to_target, _TO_TARGET, joints, near_cost)

    def plans(self, now: np.ndarray, knots: int) -> np.ndarray:
        """Targets along the shortest path, at several speeds, (n, knots, 5)."""
        if self._to_target:
            path, grasp = self._to_target[0], HANDLE.shut
        elif self._to_peg and self._to_peg[0].length > _TO_PEG.near:
            path, grasp = self._to_peg[0], HANDLE.ready
        else:
            return np.zeros((0, knots, 5))
        return plans_of(now, [Proposal(path.ahead(s, knots - 1), [grasp]) for s in _STRIDES], knots)


def _cost(paths: list[Path], toll: _Toll, joints: np.ndarray, near_cost: np.ndarray) -> np.ndarray:
    """Cost of the rest of the shortest path and, at its end, the other cost, (N,)."""
    if not paths:
        return near_cost
    left = paths[0].remaining(joints)
    far = np.clip(left / toll.near - 1.0, 0.0, 1.0)
    return far * (toll.per_radian * left + toll.besides) + (1.0 - far) * near_cost


def grasp_of(peg: Pose) -> tuple[np.ndarray, float]:
    """Position of the hand's pinch site for the grasp of a peg, (2,), and the hand's angle."""
    middle, frame = peg
    place = (middle + in_world(frame, _PINCHED))[PLANE]
    assert HANDLE.forward is not None
    forward, down = in_world(frame, HANDLE.forward)[PLANE], downwards(middle)[PLANE]
    # Along a peg that lies flat a finger would be in the floor: the hand comes from above.
    flat = float(forward[0] * down[1] - forward[1] * down[0])
    return place + _SUNK * abs(flat) * down, angle_of(forward) + _STEEP * flat


def opening(ahead: Any, aside: Any) -> np.ndarray:
    """The fingers' angle with which the hand comes to a peg, or gives back what is too deep in it.

    Args:
      ahead, aside: where in the hand the handle is, (...), metres.
    """
    is_deep = (ahead < _DEEP) & (ahead > -BACK) & (np.abs(aside) < BACK / 2)
    return np.where(is_deep, OPEN_ANGLE, HANDLE.ready)


def across(data: Any, turn: Any) -> np.ndarray:
    """Cost of fingertips near a peg that is not between them, (N,): they would pin it.

    Args:
      data: of a batch.
      turn: one less the cosine between hand and peg, (N,).
    """
    start, end = data.site_xpos["peg_grasp"], data.site_xpos["peg_tip"]
    along, offset = (end - start)[..., None, :], data.geom_xpos[TIPS] - start[..., None, :]
    part = np.clip((offset * along).sum(axis=-1) / _LENGTH**2, 0.0, 1.0)
    gap = arrays.norm(offset - part[..., None] * along)
    crossed = np.clip(10.0 * turn - 1.0, 0.0, 1.0)
    return 10.0 * crossed * np.maximum(_CLEAR - gap, 0.0).sum(axis=-1)
