"""Cost of insert_ball: release the ball into the cup.

Beside the cost of inserting: a ball that does not just fall in is released at a pose that was
tested in the planner's simulation (`releases.py`); while a ball still rolls, the arm
comes around the cup to where it can be taken; and a ball that lies on the arm is shaken off.
"""

from typing import Any, ClassVar

import numpy as np

from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, fingers
from limberjack.planner.arm.kinematics import GRASP, direction, hand_poses, nudged
from limberjack.planner.arm.proposals import Proposal, plans_of
from limberjack.planner.manipulator.grips import height_above_ground
from limberjack.planner.manipulator.insert import Insert
from limberjack.planner.manipulator.releases import Releases
from limberjack.utils import arrays

__all__ = ["InsertBall"]

_NEAR = 0.5  # radians; so near the end of its path the arm may let go
_ASTRAY = 0.8  # radians; so far off its path the arm looks for another
_STILL = 0.5  # radians per second; an arm that moves faster does not let go
_LETS_GO = 25  # plannings; how long the arm keeps still for a ball that rolls in
_WIDE = OPEN_ANGLE - 0.2  # radians; beyond the limit, so that the hand opens with all its force
_MISSED = 0.3  # metres; so far from its place the ball has not rolled in
_TRIALS = 3  # to let the ball fall in; after so many it does not
_STAND_OFF = 0.06  # metres; how far from where the ball may be taken a path ends
_ROLLS = 0.3, 0.04  # metres; how far to both sides and how high a rolling ball may be taken
_LIES = 0.05  # metres above the ground; a ball that rests higher lies on the arm
_RESTS = 0.1  # metres per second
_STIRRED = 0.03  # metres; so far a ball that is raked must move
_IN_VAIN = 30  # plannings; one that has not moved for so long is raked the other way
_SHAKES = 10  # plannings; how long it lies there before it is shaken off, and how long that lasts


class InsertBall(Insert):
    """Fetches the ball and puts it into the cup."""

    weights: ClassVar = {**Insert.weights, "ball on the arm": 20.0}
    attempts = 4
    long = 20

    def __init__(self, task: Any) -> None:
        """Takes a `manipulator.Bring` task that inserts a ball."""
        super().__init__(task)
        self._releases = Releases(self._object, task.object_joints[:2], self._receptacle)

    def reset(self) -> None:
        """Forgets what was being done about the ball."""
        super().reset()
        self._is_hard = False  # the ball does not just fall in
        self._lets_go = 0  # plannings in which the arm still keeps a pose and the hand is open
        self._kept = np.zeros(4)  # that pose
        self._lies_for = 0  # plannings in which the ball has been lying on something
        self._shakes = 0  # plannings in which it is still shaken off
        self._raked_from, self._in_vain = np.zeros(3), 0  # since when it has not moved

    def _decide(self, physics: Any) -> None:
        """Decides the stage, unless the ball is being released or shaken off."""
        away = np.hypot(*self._receptacle.offset(physics.named.data, self._object))
        self._lets_go = max(self._lets_go - 1, 0) if away < _MISSED else 0
        if not self._lets_go and not self._is_shaken_off(physics):
            super()._decide(physics)

    def stage(self) -> Any:
        """The stage, released and shaken off included."""
        return super().stage(), self._lets_go > 0, self._shakes > 0

    def _is_shaken_off(self, physics: Any) -> bool:
        """Whether the ball has come to rest on the folded arm."""
        data = physics.named.data
        is_in = self.task.get_reward(physics) > 0.5
        lies = height_above_ground(data.site_xpos[self._object]) > _LIES
        speed = np.abs(data.qvel[self.task.object_joints[:2]]).max()
        rests = bool(lies and speed < _RESTS) and not self._has and not is_in
        self._lies_for = self._lies_for + 1 if rests else 0
        self._shakes = max(self._shakes - 1, 0)
        if self._lies_for > _SHAKES:
            self._lies_for, self._shakes = 0, _SHAKES
        return self._shakes > 0

    def _turn_rake(self, data: Any) -> None:
        """Rakes the other way if the ball has not moved: it may lean on the cup."""
        place = data.site_xpos[self._object]
        if self._rake_to is None or arrays.norm(place - self._raked_from) > _STIRRED:
            self._raked_from, self._in_vain = place.copy(), 0
        self._in_vain += 1
        if self._rake_to is not None and self._in_vain // _IN_VAIN % 2:
            self._rake_to = -self._rake_to

    def terms(self, physics: Any) -> dict[str, np.ndarray]:
        """Terms of inserting; during a release, motion of the arm and of the fingers."""
        data = physics.named.data
        if self._shakes:
            return {"ball on the arm": height_above_ground(data.site_xpos[self._object])}
        if not self._lets_go:
            return super().terms(physics)
        return {
            "reward": 1.0 - self.task.get_reward(physics),
            "arm astray": np.abs(data.qpos[ARM] - self._kept).sum(axis=-1),
            "closed fingers": np.abs(fingers(data) - OPEN_ANGLE),
        }

    def _tried(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Plans of the stage; random ones to shake the ball off, none during a release."""
        if not self._lets_go and not self._shakes:
            return super()._tried(physics, random)
        now = physics.named.data.qpos[ARM]
        poses = now + random.normal(0.0, 1.0, (16, 4)) if self._shakes else [self._kept]
        return plans_of(now, [Proposal([pose], [_WIDE]) for pose in poses], self.settings.knots)

    def _carry_on(self, physics: Any) -> None:
        """Carries the ball to the mouth or, after a failure, to where it rolls in."""
        if self._is_hard:
            self._seek_release(physics)
            return
        looks = self._path is None and self._patience <= 0
        waited = self._at_mouth and self._patience < 0
        super()._carry_on(physics)
        finds_none = looks and self._path is None
        if not self._at_mouth and (finds_none or waited or self._trials > _TRIALS):
            self._is_hard, self._path = True, None
            self._releases.reset()

    def _seek_release(self, physics: Any) -> None:
        """Brings the ball to where it rolls in when it is let go, and lets it go there."""
        data = physics.named.data
        now = data.qpos[ARM]
        self._at_mouth = False
        if self._path is None:
            self._path = self._releases.path(physics, self._walls)
            self._least, self._idle = np.inf, 0
            return
        left = float(self._path.remaining(now[None])[0])
        is_still = np.abs(data.qvel[ARM]).max() < _STILL
        if left < _NEAR and is_still and self._releases.works(physics):
            self._path, self._lets_go, self._kept = None, _LETS_GO, now.copy()
        elif not self._gets_on(left):
            self._releases.reset()
            self._path = None
        elif self._path.astray(now[None])[0] > _ASTRAY:
            self._path = None

    def _has_moved(self, data: Any) -> bool:
        """Whether the path leads elsewhere; the pose to wait for a rolling ball does not move."""
        return super()._has_moved(data) and not self._is_fast(data)

    def _before_it(self, data: Any, random: np.random.Generator) -> np.ndarray:
        """Arm joints before the ball, or where a rolling ball can be taken, (n, 4)."""
        if not self._is_fast(data):
            return super()._before_it(data, random)
        places = [np.array([x, _ROLLS[1]]) for x in random.uniform(-_ROLLS[0], _ROLLS[0], 16)]
        now = data.qpos[ARM]
        found = [hand_poses(random, place, GRASP, now, 8, np.pi, 0.8) for place in places]
        takes = np.concatenate(found)
        takes = takes[self._is_clear(takes)]
        return nudged(takes, -_STAND_OFF * direction(takes.sum(axis=-1)), 0.0)
