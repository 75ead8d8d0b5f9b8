"""Detection of a lack of progress, and moves of the arm that end it.

A plan that looks half a second ahead may stand still forever: behind an object, or with one that
lies on the arm.

patience = Patience(plannings=33, part=0.9)
if patience.is_out("fetch box0", lack=0.21): ...
"""

from collections.abc import Hashable
from typing import Any

import numpy as np

from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.arm.hand import ARM, OPEN
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_poses
from limberjack.planner.arm.proposals import plans_along
from limberjack.planner.settings import Settings

__all__ = ["Patience", "plans_to", "refuge", "shelter"]

_REFUGE = 0.25, 0.25  # metres; where the hand is out of the way and the arm not folded
_SHELTER = -0.03, 0.18  # metres; where the hand waits until boxes have fallen
_SHELTERS = 48  # poses there that are compared
_FALL_FROM = 0.06  # metres; further right than this boxes may fall onto the arm
_SHAKE = 1.5  # radians; by how much joints turn to get rid of what lies on the arm
_SHAKES = 20  # that are tried


class Patience:
    """Detects that a value has not decreased for long."""

    def __init__(self, plannings: int, part: float) -> None:
        """Waits that many plannings for the value to fall to a part of the least so far."""
        self._plannings, self._part = plannings, part
        self.reset()

    def reset(self) -> None:
        """Starts the wait again."""
        self._stage: Hashable = None
        self._least = np.inf
        self._waited = 0

    def is_out(self, stage: Hashable, lack: float) -> bool:
        """Whether it has waited too long; the wait then starts again, as in another stage."""
        if stage != self._stage or lack < self._part * self._least:
            self._stage, self._least, self._waited = stage, lack, 0
        self._waited += 1
        if self._waited <= self._plannings:
            return False
        self.reset()
        return True


def refuge(data: Any, place: np.ndarray, tries: int) -> np.ndarray:
    """Joints of the arm, (4,), with the hand above a place; other ones at each try."""
    random = np.random.default_rng(tries)
    point = np.array([np.copysign(_REFUGE[0], place[0]), _REFUGE[1]])
    down = angle_of(np.array([0.0, -1.0]))
    now = data.qpos[ARM]
    poses = hand_poses(random, point, GRASP, now, 24, down, 0.7)
    if not len(poses):
        return now.copy()
    return poses[random.integers(len(poses))]


def shelter(data: Any) -> np.ndarray:
    """Joints of the arm, (4,), with as little of it as can be below where boxes fall."""
    now = data.qpos[ARM]
    down = angle_of(np.array([0.0, -1.0]))
    few = np.random.default_rng(0)
    poses = hand_poses(few, np.array(_SHELTER), GRASP, now, _SHELTERS, down, 0.7)
    if not len(poses):
        return now.copy()
    corners = -np.cumsum(np.sin(np.cumsum(poses[:, :3], axis=-1)) * GEOMETRY.lengths, axis=-1)  # x
    return poses[int(np.argmin(np.maximum(corners - _FALL_FROM, 0.0).max(axis=-1)))]


def plans_to(
    goal: np.ndarray, settings: Settings, now: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Paths of the open hand to joints, and others that shake the arm, (n, knots, 5)."""
    others = now + random.uniform(-_SHAKE, _SHAKE, (_SHAKES, 1, 4))
    ways = [plans_along(now, [[goal]], settings.knots, [OPEN], slow) for slow in (1, 2, 4)]
    return np.concatenate([*ways, plans_along(now, others, settings.knots, [OPEN])])
