"""What the planner avoids where the manipulator puts a ball into the cup.

As for anything that is inserted, and besides: a ball that does not just fall in is let go where
that has been tried in the planner's simulation (`releases.py`); while a ball still rolls, the arm
comes around the cup to where it can be taken; and a ball that lies on the arm is shaken off.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm import ARM, OPEN_ANGLE, Course, fingers, paths
from limberjack.planner.costs_insertion import Insert
from limberjack.planner.grips import height_above_ground
from limberjack.planner.planar_ik import GRASP, direction, hand_poses, nudged
from limberjack.planner.releases import Releases
from limberjack.utils import arrays

__all__ = ["InsertBall"]

_NEAR = 0.5  # radians; so near the end of its way the arm may let go
_ASTRAY = 0.8  # radians; so far off its way the arm looks for another
_STILL = 0.5  # radians per second; an arm that moves faster does not let go
_LETS_GO = 25  # plannings; how long the arm keeps still for a ball that rolls in
_WIDE = OPEN_ANGLE - 0.2  # radians; beyond the limit, so that the hand opens with all its force
_MISSED = 0.3  # metres; so far from its place the ball has not rolled in
_TRIALS = 3  # to let the ball fall in; after so many it does not
_STAND_OFF = 0.06  # metres; how far from where the ball may be taken a way ends
_ROLLS = 0.3, 0.04  # metres; how far to both sides and how high a rolling ball may be taken
_LIES = 0.05  # metres above the ground; a ball that rests higher lies on the arm
_RESTS = 0.1  # metres per second
_STIRRED = 0.03  # metres; so far a ball that is raked must move
_IN_VAIN = 30  # plannings; one that has not moved for so long is raked the other way
_SHAKES = 10  # plannings; how long it lies there before it is shaken off, and how long that lasts


class InsertBall(Insert):
    """Fetches the ball and puts it into the cup."""

    attempts = 4
    long = 20

    def __init__(self, task: Any) -> None:
        """Takes a `manipulator.Bring` task that inserts a ball."""
        super().__init__(task)
        self._releases = Releases(self._object, task._object_joints[:2], self._receptacle)

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
        """As for inserting, unless the ball is let go or shaken off."""
        away = np.hypot(*self._receptacle.offset(physics.named.data, self._object))
        self._lets_go = max(self._lets_go - 1, 0) if away < _MISSED else 0
        if not self._lets_go and not self._is_shaken_off(physics):
            super()._decide(physics)

    def stage(self) -> Any:
        """What is being done."""
        return super().stage(), self._lets_go > 0, self._shakes > 0

    def _is_shaken_off(self, physics: Any) -> bool:
        """Whether the ball has come to rest on the folded arm."""
        data = physics.named.data
        is_in = self.task.get_reward(physics) > 0.5
        lies = height_above_ground(data.site_xpos[self._object]) > _LIES
        speed = np.abs(data.qvel[self.task._object_joints[:2]]).max()
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

    def step_cost(self, physics: Any) -> np.ndarray:
        """As for inserting; while the ball is let go, what moves the arm or closes the hand."""
        data = physics.named.data
        if self._shakes:
            return 20.0 * height_above_ground(data.site_xpos[self._object])
        if not self._lets_go:
            return super().step_cost(physics)
        astray = np.abs(data.qpos[ARM] - self._kept).sum(axis=-1)
        return 1.0 - self.task.get_reward(physics) + astray + np.abs(fingers(data) - OPEN_ANGLE)

    def _tried(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """As for inserting; away from here to shake the ball off, nowhere while it is let go."""
        if not self._lets_go and not self._shakes:
            return super()._tried(physics, random)
        now = physics.named.data.qpos[ARM]
        poses = now + random.normal(0.0, 1.0, (16, 4)) if self._shakes else [self._kept]
        return paths(now, [Course([pose], [_WIDE]) for pose in poses], self.settings.knots)

    def _carry_on(self, physics: Any) -> None:
        """As for inserting; once that has failed, to where the ball rolls in."""
        if self._is_hard:
            self._seek_release(physics)
            return
        looks = self._way is None and self._patience <= 0
        waited = self._at_mouth and self._patience < 0
        super()._carry_on(physics)
        finds_none = looks and self._way is None
        if not self._at_mouth and (finds_none or waited or self._trials > _TRIALS):
            self._is_hard, self._way = True, None
            self._releases.reset()

    def _seek_release(self, physics: Any) -> None:
        """Brings the ball to where it rolls in when it is let go, and lets it go there."""
        data = physics.named.data
        now = data.qpos[ARM]
        self._at_mouth = False
        if self._way is None:
            self._way = self._releases.way(physics, self._walls)
            self._least, self._idle = np.inf, 0
            return
        left = float(self._way.remaining(now[None])[0])
        is_still = np.abs(data.qvel[ARM]).max() < _STILL
        if left < _NEAR and is_still and self._releases.works(physics):
            self._way, self._lets_go, self._kept = None, _LETS_GO, now.copy()
        elif not self._gets_on(left):
            self._releases.reset()
            self._way = None
        elif self._way.astray(now[None])[0] > _ASTRAY:
            self._way = None

    def _has_moved(self, data: Any) -> bool:
        """As for inserting; but where the hand waits for a ball does not depend on the ball."""
        return super()._has_moved(data) and not self._is_fast(data)

    def _before_it(self, data: Any, random: np.random.Generator) -> np.ndarray:
        """As for inserting, or before where a ball that rolls to and fro can be taken, (n, 4)."""
        if not self._is_fast(data):
            return super()._before_it(data, random)
        places = [np.array([x, _ROLLS[1]]) for x in random.uniform(-_ROLLS[0], _ROLLS[0], 16)]
        now = data.qpos[ARM]
        found = [hand_poses(random, place, GRASP, now, 8, np.pi, 0.8) for place in places]
        takes = np.concatenate(found)
        takes = takes[self._is_clear(takes)]
        return nudged(takes, -_STAND_OFF * direction(takes.sum(axis=-1)), 0.0)
