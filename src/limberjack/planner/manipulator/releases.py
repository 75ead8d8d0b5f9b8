"""`Releases`: poses from which a released ball gets into the cup, found by simulation.

    releases = Releases("ball", ["ball_x", "ball_z"], Receptacle.for_object("ball"))
    path = releases.path(physics, walls)  # to such a pose; None: call again
    if releases.works(physics): ...  # in the current pose

Where nothing is above the mouth, a ball that is released there falls in. Elsewhere, such as below
the arm's own base or where the hand cannot come from above, it may still roll in from beside, off
the open fingers and over the rim. Geometry does not tell which poses achieve that, so they are
tried: the arm is put there in the planner's own simulation, and the fingers open.
"""

import contextlib
from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.hand import ARM, OPEN, PLANE, in_hand
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_places, hand_poses
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.forecast import restored
from limberjack.planner.manipulator.props import Ball
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.rl.control import PhysicsError

__all__ = ["Releases"]

_ENOUGH = 3  # poses; a path leads to the nearest of them
_HOLDS = 15  # times that the arm is put back while a ball falls


class Releases:
    """Poses from which a released object gets into the receptacle."""

    def __init__(self, site: str, joints: list[str], receptacle: Receptacle) -> None:
        self._object, self._joints, self._receptacle = site, joints, receptacle
        self.reset()

    def reset(self) -> None:
        """Discards the poses."""
        self._poses: list[np.ndarray] = []

    def path(self, physics: Any, walls: Obstacle) -> Path | None:
        """A path to a pose that works; a few are tried at each call, None until one is found."""
        data = physics.named.data
        now = data.qpos[ARM].copy()
        random = np.random.default_rng(round(1000 * physics.time()))
        for pose in self._drawn(data, random, walls):
            if len(self._poses) >= _ENOUGH:
                break
            shaken = pose + random.normal(0.0, 0.02, (2, 4))  # it must also work beside
            if all(self.works(physics, each) for each in (pose, *shaken)):
                self._poses.append(pose)
        if len(self._poses) < _ENOUGH:
            return None
        found = find_path(now, np.array(self._poses), Ball.held, walls)
        if found is None:
            self.reset()
        return found

    def works(self, physics: Any, pose: np.ndarray | None = None) -> bool:
        """Whether the object gets in if released at a pose (4,), by default the current one.

        It must be within 2 cm of its place after 0.6 seconds.
        """
        data = physics.named.data
        ahead, aside = (float(d) for d in in_hand(data, data.site_xpos[self._object]))
        kept: np.ndarray = data.qpos[ARM].copy() if pose is None else pose
        is_in = False
        with restored(physics), contextlib.suppress(PhysicsError):
            data.qpos[ARM] = kept
            data.qpos[self._joints] = hand_places(kept, GRASP + ahead, aside)
            data.qvel[:] = 0.0
            physics.set_control(np.array([0.0, 0.0, 0.0, 0.0, OPEN]))
            for _ in range(_HOLDS):
                physics.step(round(0.6 / _HOLDS / physics.timestep()))
                data.qpos[ARM], data.qvel[ARM] = kept, 0.0
            physics.forward()
            offset = self._receptacle.offset(data, self._object)
            is_in = bool(np.abs(offset).max() < 0.02)
        return is_in

    def _drawn(self, data: Any, random: np.random.Generator, walls: Obstacle) -> np.ndarray:
        """Poses around the mouth that point to it and are clear of the walls, (n, 4).

        Four at each of 16 places, up and beside in the mouth's frame in metres; the hand may point
        elsewhere by 0.6 radians.
        """
        now, target = data.qpos[ARM], data.site_xpos[self._receptacle.target][PLANE]
        axis, across = self._receptacle.axes(data)
        ahead = float(in_hand(data, data.site_xpos[self._object])[0])
        mouth = target + 0.7 * self._receptacle.before * axis
        poses = []
        for up, beside in random.uniform([0.09, -0.14], [0.2, 0.14], (16, 2)):
            place = target + up * axis + beside * across
            angle = angle_of(mouth - place)
            poses.extend(hand_poses(random, place, GRASP + ahead, now, 4, angle, 0.6))
        found = np.array(poses).reshape(-1, 4)
        gaps = clearance(found, Ball.held, walls)
        return found[(gaps[:, 0] > -0.001) & (gaps[:, 1:].min(axis=1) > 0)]
