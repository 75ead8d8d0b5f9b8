"""Cost of insert_peg: reach the peg around the slot, and push it in.

A peg is harder to get at than a ball. The slot may be in the way to it; it may lean on the slot, or
lie where no hand gets to its handle; then it is raked from elsewhere, or away from what it leans
on.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.hand import ARM, PLANE
from limberjack.planner.arm.kinematics import GRASP, direction, nudged
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.bring_peg import BLADE, HAND, STRETCHED, BringPeg
from limberjack.planner.manipulator.grips import Pose, pose_of
from limberjack.planner.manipulator.insert import Insert
from limberjack.planner.manipulator.pushes import pushes
from limberjack.utils import arrays

__all__ = ["InsertPeg"]

_PER_RADIAN = 0.4  # what a radian of the arm's path costs
_STAND_OFF, _CLOSE = (
    0.06,
    0.01,
)  # metres from the peg to a path's end, or else if there is none
_PEG = GRASP + 0.113  # metres; from the wrist to the tip of a peg that is held
_OVER = 0.02, -0.01  # metres; how far above the place before the mouth a path ends
_TOUCHING = -0.004  # metres; fingers may be so near to walls that they touch them
_GOALS, _FEW = 96, 12  # poses in which a path may end, and those of another attempt
_TRIED = 8  # poses that are clear of the walls, at best, of which the nearest are taken
_ALONG = 24  # points of a path that are looked at
_STIRRED = 0.03  # metres; proposals to a peg are looked for again once it has moved so far
# Metres above where a fingertip rakes: it gets there from them, where the hand would be in a wall.
_HIGHER = 0.0, 0.03, 0.06
_MISSES = 2  # failed searches for a path after which a peg is raked


class InsertPeg(Insert, BringPeg):
    """Fetches the peg and inserts it."""

    mouth_noise_scale = 0.1  # the slot is narrow

    def reset(self) -> None:
        """Forgets what was in the way."""
        super().reset()
        self._raked_from = np.zeros(3)  # where the peg was at the first of them
        self._is_blocked = False  # whether the slot is in the known path to the peg
        self._missed = 0  # failed searches for a path to the peg since it has moved

    def _raking(self, data: Any, goal: float) -> np.ndarray:
        """Cost of raking; before, the remaining path of the arm, (N,)."""
        if self._path is None or self._spots.now is None:
            return super()._raking(data, goal)
        return _PER_RADIAN * self._path.remaining(data.qpos[ARM])

    def _watch_arm(self, data: Any) -> None:
        """Detects a peg on the arm; the arm then needs another path."""
        before = self._lies_on_arm()
        super()._watch_arm(data)
        if self._lies_on_arm() != before:
            self._path, self._patience = None, -1

    def _find_path_to_target(self, physics: Any) -> None:
        """None but the one around the slot."""
        self._paths.forget()

    def _find_path_to_object(self, physics: Any) -> None:
        """Searches for a path to the peg that does not pass through the slot."""
        super()._find_path_to_object(physics)
        self._is_blocked = False
        along = self._paths.plans(physics.named.data.qpos[ARM], _ALONG)
        if len(along):
            poses = along[0][1:, : len(ARM)]
            poses = np.concatenate([poses[1:], (poses[1:] + poses[:-1]) / 2])
            if clearance(poses, HAND, self._walls)[:, 0].min() < _TOUCHING:
                self._is_blocked = True
                self._paths.forget()

    def _is_led(self) -> bool:
        """Whether the arm is still on a path to where it rakes."""
        return self._path is not None

    def _turn_rake(self, data: Any) -> None:
        """Rakes a peg to which no path leads, and from elsewhere what does not come nearer."""
        place = data.site_xpos[self._object]
        if arrays.norm(place - self._raked_from) > _STIRRED:
            self._raked_from, self._missed = place.copy(), 0
        if self._lies_on_arm():
            self._rake_to, self._missed = None, 0
        if self._missed >= _MISSES and self._rake_to is None:
            self._rake_to = self._rake_goal(data)
        before = self._spots.now
        super()._turn_rake(data)
        if self._spots.now is not before and self._rake_to is not None:
            self._path, self._patience = None, -1

    def _must_be_led(self) -> bool:
        """Whether the arm rakes or lets the peg fall, or its known path goes through the slot."""
        return self._rake_to is not None or self._lies_on_arm() or self._is_blocked

    def _path_to_object(self, physics: Any, attempt: int) -> Path | None:
        """The arm's path around the slot: to before the peg, to rake it, or to let it fall."""
        data = physics.named.data
        now, walls = data.qpos[ARM], self._walls
        random = self._draws
        if self._rake_to is not None:
            return self._path_to_rake(data, self._rake_to)
        if self._lies_on_arm():
            return find_path(now, random.uniform(-STRETCHED, STRETCHED, (8, 4)), HAND, walls)
        if self._is_fast(data):
            return None
        # From where the hand gets on to the peg: there, too, the walls must leave it room.
        (poses,) = self._poses_around([pose_of(data, "peg")], now, random, _GOALS)
        if attempt:
            poses = poses[random.permutation(len(poses))[:_FEW]]
        path = None
        # On its path the hand would push the peg away.
        for back, start in ((_STAND_OFF, "peg_grasp"), (_CLOSE, "peg")):
            goals = nudged(poses, -back * direction(poses.sum(axis=-1)), 0.0)
            peg = data.site_xpos[[start, "peg_tip"]][None][..., PLANE]
            around = Obstacle(np.concatenate([walls.ends, peg]), np.append(walls.radii, BLADE))
            path = path or find_path(now, goals, HAND, around, close=True)
        self._missed = 0 if path is not None else self._missed + 1
        return path

    def _path_to_rake(self, data: Any, goal: float) -> Path | None:
        """The arm's path to where it rakes, or to above there."""
        spot = self._spots.now
        if spot is None:
            return None
        for higher in _HIGHER:
            poses = spot.poses(data, goal, self._walls, higher)
            path = find_path(data.qpos[ARM], poses, HAND, self._walls, close=True)
            if path is not None:
                return path
        return None

    def _path_to_mouth(self, physics: Any) -> Path | None:
        """The path to the mouth for hand and peg or, if there is none, for the hand."""
        data = physics.named.data
        random = np.random.default_rng(self._trials)
        for over in _OVER:  # the lower ones are nearer to the arm, if the mouth is far away
            goals = self._poses_to(data, random, self._receptacle.before + over, 0.0, _GOALS)
            if self._trials:  # not where it has not succeeded
                goals = goals[random.permutation(len(goals))[:_FEW]]
            for held in (_PEG, HAND):
                path = find_path(data.qpos[ARM], goals, held, self._walls, close=True)
                if path is not None:
                    return path
        return None

    def _poses_around(
        self,
        objects: list[Pose],
        now: np.ndarray,
        random: np.random.Generator,
        count: int,
        back: float = 0.0,
        tilt: float = 0.5,
    ) -> list[np.ndarray]:
        """Arm joints around the peg, of more draws: few may be clear of the walls."""
        found = super()._poses_around(objects, now, random, max(count, _TRIED), back, tilt)
        return [poses[:count] for poses in found]

    def _proposals_in(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to push the peg in."""
        now, count, press = data.qpos[ARM], self.settings.knots, self._grip.shut
        return pushes(random, data, self._receptacle, now, count, press)
