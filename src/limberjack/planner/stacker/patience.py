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
from limberjack.planner.arm.kinematics import GRASP, hand_poses
from limberjack.planner.arm.proposals import plans_along
from limberjack.planner.settings import Settings
from limberjack.planner.stacker.boxes import DOWN

__all__ = ["Patience", "plans_to", "refuge", "shelter"]


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
    # Metres; there the hand is out of the way, and the arm not folded.
    poses = _pointing_down(data, random, [np.copysign(0.25, place[0]), 0.25], 24)
    return poses[random.integers(len(poses))]


def shelter(data: Any) -> np.ndarray:
    """Joints of the arm, (4,), with as little of it as can be below where boxes fall."""
    poses = _pointing_down(data, np.random.default_rng(0), [-0.03, 0.18], 48)
    corners = -np.cumsum(np.sin(np.cumsum(poses[:, :3], axis=-1)) * GEOMETRY.lengths, axis=-1)  # x
    # Boxes fall further right than 60 mm.
    return poses[int(np.argmin(np.maximum(corners - 0.06, 0.0).max(axis=-1)))]


def _pointing_down(
    data: Any, random: np.random.Generator, place: list[float], count: int
) -> np.ndarray:
    """Joints with the hand at x and z, about downwards, (n, 4); the present ones if none reach."""
    now = data.qpos[ARM]
    poses = hand_poses(random, np.array(place), GRASP, now, count, DOWN, 0.7)
    return poses if len(poses) else now[None].copy()


def plans_to(
    goal: np.ndarray, settings: Settings, now: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Paths of the open hand to joints, and others that shake the arm, (n, knots, 5)."""
    others = now + random.uniform(-1.5, 1.5, (20, 1, 4))
    ways = [plans_along(now, [[goal]], settings.knots, [OPEN], slow) for slow in (1, 2, 4)]
    return np.concatenate([*ways, plans_along(now, others, settings.knots, [OPEN])])
