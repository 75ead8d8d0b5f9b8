"""`Release`: a ball gets into the cup even where it does not just fall in, or off the arm.

    release = Release(task, fetch, cup)
    release.update(physics)  # whether the arm waits for the ball, or shakes it off
    release.seek(physics)    # leads the arm to where the ball rolls in, and opens the hand there

Where nothing is above the mouth, a ball that is released there falls in. Elsewhere, such as below
the arm's own base or where the hand cannot come from above, it may still roll in from beside, off
the open fingers and over the rim. Geometry does not tell which poses achieve that, so they are
tried: the arm is put there in the planner's own simulation, and the fingers open. A ball that lies
on the arm is shaken off.
"""

import contextlib

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.collision import clearance
from limberjack.planner.arm.hand import ARM, OPEN, OPEN_ANGLE, PLANE, fingers, in_hand
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_places, hand_poses
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.proposals import Proposal, plans_of
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.arm.watchdog import Watchdog
from limberjack.planner.cost import AnyTask
from limberjack.planner.manipulator.fetch import ARRIVED, Fetch
from limberjack.planner.manipulator.forecast import restored
from limberjack.planner.manipulator.props import Ball, height_above_ground
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.rl.control import PhysicsError

__all__ = ["Release"]

_SHAKES = 10  # plannings that a ball lies on the arm before it is shaken off, and while it is
_WAITS = 25  # plannings that the arm keeps still after the hand has opened
_ENOUGH = 3  # poses from which the ball gets in; a path leads to the nearest of them
_HOLDS = 15  # times that the arm is put back while a ball falls
_FALL = 0.6  # seconds in which a ball must get in
_IN = 0.02  # metres from its place, within which it is in
_ROLLS = 0.3  # metres; a ball that is further away from its place does not roll in any more
_ALOFT = 0.05  # metres above the ground; a ball that rests higher lies on the arm
_RESTS = 0.1  # metres per second
_STILL = 0.5  # radians per second
_SHAKEN = 0.02  # radians; spread of the poses beside one, from which the ball must get in too


class Release:
    """Release of a ball that does not just fall in, and recovery of one that lies on the arm."""

    def __init__(self, task: AnyTask, fetch: Fetch, cup: Receptacle) -> None:
        self._task, self._fetch, self._cup = task, fetch, cup
        self.is_due = False  # whether the ball is released at a tested pose
        self.waits = 0  # plannings in which the arm still keeps a pose with an open hand
        self.shakes = 0  # plannings in which the ball is still shaken off
        self._kept = np.zeros(4)  # the arm's joints while it waits
        self._lying = Watchdog(_SHAKES)  # of the ball on the arm
        self._poses: list[np.ndarray] = []  # from which the ball gets in

    @property
    def is_busy(self) -> bool:
        """Whether the arm waits for the ball to roll in, or shakes it off."""
        return self.waits > 0 or self.shakes > 0

    def update(self, physics: Physics) -> bool:
        """Counts the plannings; returns `is_busy`."""
        away = np.hypot(*self._cup.offset(physics.named.data, "ball"))
        self.waits = max(self.waits - 1, 0) if away < _ROLLS else 0
        if not self.waits:
            self._watch_arm(physics)
        return self.is_busy

    def _watch_arm(self, physics: Physics) -> None:
        """Begins to shake the arm if the ball has come to rest on it."""
        data = physics.named.data
        is_in = self._task.get_reward(physics) > 0.5
        lies = height_above_ground(data.site_xpos["ball"]) > _ALOFT
        speed = np.abs(data.qvel[self._fetch.prop.joints[:2]]).max()
        rests = bool(lies and speed < _RESTS) and not self._fetch.has and not is_in
        self.shakes = max(self.shakes - 1, 0)
        if not rests:
            self._lying.begin()
        elif self._lying.watch():
            self._lying.begin()
            self.shakes = _SHAKES

    def begin(self) -> None:
        """Releases the ball at a tested pose from now on, since it does not just fall in."""
        self.is_due = True
        self._fetch.drop_path(0)

    def seek(self, physics: Physics) -> None:
        """Leads the arm to a pose from which the ball rolls in, and opens the hand there.

        It opens where the arm is still and near the end of its path, and then waits for the ball.
        """
        data, fetch = physics.named.data, self._fetch
        path = fetch.path
        if path is None:
            fetch.follow(self._path(physics), 0)
            return
        is_still = np.abs(data.qvel[ARM]).max() < _STILL
        if path.left < ARRIVED and is_still and self.works(physics):
            fetch.drop_path(0)
            self.waits, self._kept = _WAITS, data.qpos[ARM].copy()
        elif path.is_stalled:
            fetch.drop_path(0)
            self._poses = []
        elif path.is_astray:
            fetch.drop_path(0)

    def _path(self, physics: Physics) -> Path | None:
        """A path to a pose that works; a few are tried at each call, None until one is found."""
        data, walls = physics.named.data, self._fetch.approach.walls
        now = data.qpos[ARM].copy()
        random = np.random.default_rng(round(1000 * physics.time()))
        for pose in self._drawn(data, random):
            if len(self._poses) >= _ENOUGH:
                break
            shaken = pose + random.normal(0.0, _SHAKEN, (2, 4))
            if all(self.works(physics, each) for each in (pose, *shaken)):
                self._poses.append(pose)
        if len(self._poses) < _ENOUGH:
            return None
        found = find_path(now, np.array(self._poses), Ball.held, walls)
        if found is None:
            self._poses = []
        return found

    def works(self, physics: Physics, pose: np.ndarray | None = None) -> bool:
        """Whether the ball gets in if released at a pose (4,), by default the current one."""
        data, joints = physics.named.data, self._fetch.prop.joints[:2]
        ahead, aside = (float(d) for d in in_hand(data, data.site_xpos["ball"]))
        kept: np.ndarray = data.qpos[ARM].copy() if pose is None else pose
        is_in = False
        with restored(physics), contextlib.suppress(PhysicsError):
            data.qpos[ARM] = kept
            data.qpos[joints] = hand_places(kept, GRASP + ahead, aside)
            data.qvel[:] = 0.0
            physics.set_control(np.array([0.0, 0.0, 0.0, 0.0, OPEN]))
            for _ in range(_HOLDS):
                physics.step(round(_FALL / _HOLDS / physics.timestep()))
                data.qpos[ARM], data.qvel[ARM] = kept, 0.0
            physics.forward()
            is_in = bool(np.abs(self._cup.offset(data, "ball")).max() < _IN)
        return is_in

    def _drawn(self, data: NamedFields, random: np.random.Generator) -> np.ndarray:
        """Poses around the mouth that point to it and are clear of the walls, (n, 4).

        Four at each of 16 places, up and beside in the mouth's frame in metres; the hand may point
        elsewhere by 0.6 radians.
        """
        now, target = data.qpos[ARM], data.site_xpos[self._cup.target][PLANE]
        axis, across = self._cup.axes(data)
        ahead = float(in_hand(data, data.site_xpos["ball"])[0])
        mouth = target + 0.7 * self._cup.before * axis
        poses = []
        for up, beside in random.uniform([0.09, -0.14], [0.2, 0.14], (16, 2)):
            place = target + up * axis + beside * across
            angle = angle_of(mouth - place)
            poses.extend(hand_poses(random, place, GRASP + ahead, now, 4, angle, 0.6))
        found = np.array(poses).reshape(-1, 4)
        gaps = clearance(found, Ball.held, self._fetch.approach.walls)
        return found[(gaps[:, 0] > -0.001) & (gaps[:, 1:].min(axis=1) > 0)]

    def terms(self, physics: Physics) -> dict[str, np.ndarray]:
        """Terms of shaking, or of an arm that keeps still with an open hand, (N,) each."""
        data = physics.named.data
        if self.shakes:
            return {"ball on the arm": height_above_ground(data.site_xpos["ball"])}
        return {
            "reward": 1.0 - self._task.get_reward(physics),
            "arm astray": np.abs(data.qpos[ARM] - self._kept).sum(axis=-1),
            "closed fingers": np.abs(fingers(data) - OPEN_ANGLE),
        }

    def plans(self, data: NamedFields, random: np.random.Generator, knots: int) -> np.ndarray:
        """Random plans that shake the ball off; one that keeps still, to wait, (n, knots, 5)."""
        now = data.qpos[ARM]
        poses = now + random.normal(0.0, 1.0, (16, 4)) if self.shakes else [self._kept]
        wide = OPEN_ANGLE - 0.2  # beyond the limit, so that the hand opens with all its force
        return plans_of(now, [Proposal([pose], [wide]) for pose in poses], knots)
