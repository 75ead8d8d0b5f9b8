"""Cost of inserting an object into a receptacle.

The object is fetched as to bring it. The arm carries it before the mouth of the receptacle, on a
path around the receptacle's walls. There the ball is released, and falls or rolls in; the peg is
pushed in by small straight steps. A failed attempt is repeated from another pose. `insert_ball.py`
and `insert_peg.py` build on this cost.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.collision import clearance
from limberjack.planner.arm.hand import (
    ARM,
    LONGEST,
    OPEN_ANGLE,
    PLANE,
    fingers,
    in_hand,
    loose,
    sag,
)
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_poses
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, lifts, plans_of
from limberjack.planner.arm.roadmap import draw_roadmap, find_path
from limberjack.planner.manipulator.bring import Bring
from limberjack.planner.manipulator.grips import Pose, in_world, pose_of
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.utils import arrays

__all__ = ["Insert"]

_NEAR = 0.1  # metres; what scales distances before the mouth, where they are short
_FACING = 0.7  # cosine between hand and axis, from which on the hand faces the mouth
_PER_RADIAN = 0.4  # what a radian of the arm's path costs
_FAR = 4.0  # what the longest path costs
_FINE = 0.1  # of the usual breadth of plans, once the object is in its place
_ASTRAY = 0.8  # radians; so far off its path the arm looks for another
_ARRIVED = 0.5  # radians; so near its end a path has been gone
_PRESS = 0.25  # control of the grasp under which an object may slip
_PATIENCE = 10  # plannings; after so many another path is looked for
_SPARE = 2  # times as many poses are drawn as are wanted that are clear of the walls
_GOALS = 96  # poses in which a path may end; many of them are blocked
_STAND_OFF = 0.06  # metres; how far from the object a path to it ends
_IDLE = 30  # plannings; without headway for so long another path is searched
_HEADWAY = 0.1  # radians; less is none
_TOUCHING = -0.004  # metres; fingers may be so near to walls that they touch them
_REACHED, _LEFT = 0.07, 0.1  # metres; so near it the object is before the mouth, and no longer
_FAST = 1.0  # metres per second; what is faster will not be where a path leads to
_OVER = 0.02  # metres; how far above the place before the mouth a path ends


class Insert(Bring):
    """Fetches the object and inserts it.

    Attributes:
      attempts: spans of patience; after so many the object is approached in another pose.
      long: plannings; then insertion is tried from elsewhere.
      mouth_noise_scale: of plans before the mouth, as a part of the usual.
    """

    attempts = 8
    long = 60
    mouth_noise_scale = 1.0

    def __init__(self, task: Any) -> None:
        """Takes a `manipulator.Bring` task that inserts."""
        self._receptacle = Receptacle.for_object(self._object)
        draw_roadmap()
        super().__init__(task)

    def reset(self) -> None:
        """Discards the paths."""
        super().reset()
        self._stands_at = np.full(3, np.nan)  # where the receptacle is, metres
        self._path: Path | None = None  # around the receptacle
        self._holds = self._is_in = False
        self._at_mouth = False
        self._patience = 0  # plannings until another path is looked for
        self._found_at = np.zeros(3)  # where the object was when a path to it was found
        self._attempts = 0  # to take it
        self._trials = 0  # to insert what is held now
        self._least, self._idle = np.inf, 0  # radians left of the path, and since when

    def _decide(self, physics: Any) -> None:
        """Decides the stage and the arm's path; an object in its place is left there."""
        data = physics.named.data
        place = data.site_xpos[self._receptacle.target]
        if not np.array_equal(place, self._stands_at):
            self._stands_at, self._walls = place.copy(), self._receptacle.walls(physics)
        holds = self._has
        if holds != self._holds:
            self._path, self._patience, self._trials, self._attempts = None, 0, 0, 0
        self._holds = holds
        self._at_mouth = self._at_mouth and holds
        is_in = self._receptacle.holds(self._receptacle.offset(data, self._receptacle.sites[0]))
        self._is_in = bool(is_in > 0.5)
        if self._is_in and not holds:
            self._rake_to = self._path = None
            self._sag = np.zeros(4)
            self.noise_scale = _FINE
            return
        super()._decide(physics)
        self._sag = sag(physics, self.settings.gain)
        self._patience -= 1
        if self._path is not None:
            self._path.advance(data.qpos[ARM])
        if holds:
            self._carry_on(physics)
        else:
            self._approach(physics)
        self.noise_scale = self.mouth_noise_scale if self._at_mouth else 1.0

    def stage(self) -> Any:
        """The stage, and the path that the arm follows."""
        return super().stage(), self._path, self._at_mouth, self._is_in

    def _approach(self, physics: Any) -> None:
        """Keeps the arm's path to the object, or looks for one if that is blocked."""
        data = physics.named.data
        now = data.qpos[ARM][None]
        place = data.site_xpos[self._object]
        if self._path is not None:
            left = float(self._path.remaining(now)[0])
            if left < _ARRIVED:
                self._path, self._patience = None, _PATIENCE
                return
            if not self._gets_on(left):
                self._attempts = self.attempts
            elif not self._has_moved(data) and self._path.astray(now)[0] < _ASTRAY:
                return
        elif self._patience >= 0:
            return
        self._patience, self._found_at = _PATIENCE, place.copy()
        self._attempts += 1
        again = self._attempts > self.attempts
        path = self._path_to_object(physics, self._attempts if again else 0)
        blocked = path is not None and not path.is_straight
        # An arm that has left a dead end does not return there because the path is straight now.
        keep = blocked or again or self._path is not None or self._must_be_led()
        self._path = path if keep else None
        self._least, self._idle = np.inf, 0
        if again and path is not None:
            self._attempts = self.attempts // 2

    def _carry_on(self, physics: Any) -> None:
        """Decides whether the object is before the mouth, or else the arm's path there."""
        data = physics.named.data
        now = data.qpos[ARM][None]
        awry = max(_FACING - float(self._receptacle.facing(data)), 0.0)
        away = self._receptacle.from_mouth(data) + 0.1 * awry
        is_near = away < (_LEFT if self._at_mouth else _REACHED)
        arrived = self._path is not None and self._path.remaining(now)[0] < _ARRIVED
        if self._at_mouth:
            if is_near and (self._patience >= 0 or self.task.get_reward(physics) > 0.5):
                return
            # It took too long, or the object has gone: now from elsewhere.
            self._at_mouth, self._patience = False, 0
            self._trials += 1
        elif arrived or (is_near and self._trials == 0):
            self._at_mouth, self._path, self._patience = True, None, self.long
            return
        if self._path is not None:
            if not self._gets_on(float(self._path.remaining(now)[0])):
                self._path, self._patience = None, 0
                self._trials += 1
            elif self._path.astray(now)[0] > _ASTRAY:
                self._path, self._patience = None, min(self._patience, 0)
        if self._path is None and self._patience <= 0:
            self._patience = _PATIENCE
            self._path = self._path_to_mouth(physics)
            self._least, self._idle = np.inf, 0

    def _must_be_led(self) -> bool:
        """Whether the arm is to follow a path even if that is straight."""
        return False

    def _is_fast(self, data: Any) -> bool:
        """Whether the object will soon be elsewhere."""
        return bool(np.abs(data.qvel[self.task.object_joints[:2]]).max() > _FAST)

    def _has_moved(self, data: Any) -> bool:
        """Whether the object is no longer where the path to it leads."""
        return bool(arrays.norm(data.site_xpos[self._object] - self._found_at) > _STAND_OFF)

    def _gets_on(self, left: float) -> bool:
        """Whether the arm has made headway on its path of late."""
        if left < self._least - _HEADWAY:
            self._least, self._idle = left, 0
        self._idle += 1
        return self._idle < _IDLE

    def _path_to_object(self, physics: Any, attempt: int) -> Path | None:
        """The arm's path around the receptacle to before the object; 0 for the shortest."""
        data = physics.named.data
        if self._rake_to is not None:
            return None
        goals = self._before_it(data, self._draws)
        if attempt:
            goals = goals[self._draws.permutation(len(goals))[: _GOALS // 8]]
        return find_path(data.qpos[ARM], goals, GRASP + 0.02, self._walls)

    def _before_it(self, data: Any, random: np.random.Generator) -> np.ndarray:
        """Arm joints from which the hand can go straight on to the object, (n, 4)."""
        if self._is_fast(data):
            return np.zeros((0, 4))
        now, lies = data.qpos[ARM], [pose_of(data, self._object)]
        return self._poses_around(lies, now, random, _GOALS, _STAND_OFF)[0]

    def _path_to_mouth(self, physics: Any) -> Path | None:
        """The arm's path around the receptacle to before its mouth; another one at each trial."""
        data = physics.named.data
        random = np.random.default_rng(self._trials)
        length = GRASP + 0.022
        over = self._receptacle.before + _OVER
        goals = self._poses_to(data, random, over, 0.0, _GOALS)
        if self._trials:  # few: not where it has not succeeded
            goals = goals[random.permutation(len(goals))[: _GOALS // 8]]
        return find_path(data.qpos[ARM], goals, length, self._walls)

    def _carrying(self, physics: Any, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Certainty that the object needs no fetching, 0 to 1, and cost of inserting, (N,) each."""
        data = physics.named.data
        offsets = self._receptacle.offsets(data)
        missing = 1.0 - self.task.get_reward(physics)
        cost = missing + held * loose(physics, _PRESS)
        if self._path is not None and self._holds:
            left = _PER_RADIAN * self._path.remaining(data.qpos[ARM])
        else:
            left = self._receptacle.distance(offsets) / (_NEAR if self._at_mouth else LONGEST)
            left = left + held * np.maximum(_FACING - self._receptacle.facing(data), 0.0)
        # Always less than what an object costs that is not held.
        cost = cost + _FAR * np.tanh(left / _FAR)
        return np.maximum(held, self._receptacle.holds(offsets[0])), cost

    def _fetching(self, data: Any, offset: tuple[Any, Any]) -> np.ndarray:
        """Cost of fetching; around the receptacle, the remaining path of the arm, (N,)."""
        if self._path is None or self._holds:
            return super()._fetching(data, offset)
        unready = np.abs(fingers(data) - self._grip.ready)
        return 2.0 + 1.5 * _PER_RADIAN * self._path.remaining(data.qpos[ARM]) + 2.0 * unready

    def _poses_around(
        self,
        objects: list[Pose],
        now: np.ndarray,
        random: np.random.Generator,
        count: int,
        back: float = 0.0,
        tilt: float = 0.5,
    ) -> list[np.ndarray]:
        """Arm joints around an object with the hand clear of the receptacle's walls."""
        found = super()._poses_around(objects, now, random, _SPARE * count, back, tilt)
        is_clear = self._is_clear(np.concatenate(found))
        ends = np.cumsum([len(poses) for poses in found])[:-1]
        left = [poses[ok] for poses, ok in zip(found, np.split(is_clear, ends), strict=True)]
        return [poses[:: max(1, len(poses) // count)][:count] for poses in left]

    def _is_clear(self, poses: np.ndarray) -> np.ndarray:
        """In which poses (n, 4) the hand is not in the receptacle's walls, (n,)."""
        if not len(poses):
            return np.zeros(0, bool)
        return clearance(poses, GRASP + 0.02, self._walls)[:, 0] > _TOUCHING

    def _poses_to(
        self,
        data: Any,
        random: np.random.Generator,
        up: float,
        beside: float,
        count: int,
        tilt: float = 0.6,
    ) -> np.ndarray:
        """Arm joints that have the held object at a place in the mouth's frame, (n, 4)."""
        now = data.qpos[ARM]
        grip = self._grip
        target = self._receptacle.target
        axis, across = self._receptacle.axes(data)
        goal = data.site_xpos[target] + in_world(data.site_xmat[target], grip.place)
        point = goal[PLANE] + up * axis + beside * across
        ahead, aside = in_hand(data, self._place(data))
        angle = angle_of(-axis)
        if grip.forward is not None:
            held = angle_of(in_world(data.site_xmat[self._object], grip.forward)[PLANE])
            angle, tilt = angle + float(now.sum()) - held, 0.01
        return hand_poses(random, point, GRASP + ahead, now, count, angle, tilt, aside)

    def _tried(self, physics: Any, random: np.random.Generator) -> np.ndarray:
        """Plans of the stage; once the object is in its place, away from it."""
        data = physics.named.data
        if self._has or not self._is_in:
            found = super()._tried(physics, random)
            if self._path is not None:
                press = self._grip.shut if self._holds else OPEN_ANGLE
                ahead = [self._path.next_points(stride) for stride in (2, 4, 7, 12, 18, 26)]
                proposals = [Proposal(passed[: self.settings.knots], [press]) for passed in ahead]
                along = plans_of(data.qpos[ARM], proposals, self.settings.knots)
                found = np.concatenate([along, found[:12]])
            return found
        now = data.qpos[ARM]
        proposals = [Proposal([now], [OPEN_ANGLE])]
        above = data.site_xpos["grasp"][PLANE] - 0.05 * data.site_xmat["grasp"][[2, 8]]
        for pose in hand_poses(random, above, GRASP, now, 4, float(now.sum()), 0.3):
            proposals.extend(Proposal([pose], [OPEN_ANGLE], slow) for slow in (1, 3))
        return plans_of(now, proposals, self.settings.knots)

    def _carrying_proposals(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals that carry the object to the mouth, and in."""
        now, press = data.qpos[ARM], self._grip.shut
        mouth = self._receptacle
        proposals = [Proposal([now], [press])]
        up, beside = mouth.offset(data, mouth.sites[0])
        if np.hypot(up - mouth.before, beside) < 0.06 or (up > 0 and abs(beside) < mouth.width):
            proposals.extend(self._proposals_in(data, random))
            poses = self._poses_to(data, random, mouth.before, 0.0, 2)
        else:
            poses = self._poses_to(data, random, mouth.before, 0.0, 6)
            high = self._poses_to(data, random, mouth.before + 0.06, 0.0, 3)
            proposals.extend(Proposal([pose], [press], slow) for pose in high for slow in (1, 3))
        proposals.extend(Proposal([pose], [press], slow) for pose in poses for slow in (1, 2, 4))
        place, angle = data.site_xpos["grasp"][PLANE], float(now.sum())
        proposals.extend(lifts(random, place, angle, now, press)[::2])
        return proposals

    def _proposals_in(self, data: Any, random: np.random.Generator) -> list[Proposal]:
        """Proposals to let the ball fall."""
        now, press = data.qpos[ARM], self._grip.shut
        proposals: list[Proposal] = []
        for let_go in (OPEN_ANGLE, self._grip.ready):
            proposals.append(Proposal([now], [let_go]))
            proposals.append(Proposal([now], [press, let_go]))
            for _ in range(8):
                place = random.uniform([-0.05, -0.016], [0.03, 0.016])
                for pose in self._poses_to(
                    data, random, self._receptacle.before + place[0], place[1], 1
                ):
                    proposals.append(Proposal([pose], [press, let_go]))
                    proposals.append(Proposal([pose], [let_go], 2))
        return proposals
