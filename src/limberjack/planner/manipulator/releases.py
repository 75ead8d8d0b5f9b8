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
from limberjack.planner.arm.hand import ARM, PLANE, in_hand
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_places, hand_poses
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.props import Ball
from limberjack.planner.manipulator.receptacles import Receptacle
from limberjack.rl.control import PhysicsError

__all__ = ["Releases"]

_UP, _BESIDE = (0.09, 0.2), 0.14  # metres; release points in the mouth's frame
_TURN = 0.6  # radians; how far from the direction to the mouth the hand may point
_PLACES, _POSES = 16, 4  # that are drawn at a time, and poses at each
_SHAKEN, _SHAKES = 0.02, 2  # radians; a pose must also work so far beside, and how often
_ENOUGH = 3  # poses; a path leads to the nearest of them
_FALL, _HOLDS = 0.6, 15  # seconds until the ball must be in; how often the arm is put back then
_TOUCHING = -0.001  # metres; so near to walls a pose may be
_IN = 0.02  # metres


class Releases:
    """Poses from which a released object gets into the receptacle."""

    def __init__(self, site: str, joints: list[str], receptacle: Receptacle) -> None:
        """Takes the object's site and its joints along x and z."""
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
            shaken = pose + random.normal(0.0, _SHAKEN, (_SHAKES, 4))
            if all(self.works(physics, each) for each in (pose, *shaken)):
                self._poses.append(pose)
        if len(self._poses) < _ENOUGH:
            return None
        found = find_path(now, np.array(self._poses), Ball.held, walls)
        if found is None:
            self.reset()
        return found

    def works(self, physics: Any, pose: np.ndarray | None = None) -> bool:
        """Whether the object gets in if released at a pose (4,), by default the current one."""
        data = physics.named.data
        state, control = physics.get_state(), physics.control().copy()
        ahead, aside = (float(d) for d in in_hand(data, data.site_xpos[self._object]))
        kept: np.ndarray = data.qpos[ARM].copy() if pose is None else pose
        data.qpos[ARM] = kept
        data.qpos[self._joints] = hand_places(kept, GRASP + ahead, aside)
        data.qvel[:] = 0.0
        physics.set_control(np.array([0.0, 0.0, 0.0, 0.0, -1.0]))
        steps = round(_FALL / _HOLDS / physics.timestep())
        is_in = False
        with contextlib.suppress(PhysicsError):
            for _ in range(_HOLDS):
                physics.step(steps)
                data.qpos[ARM], data.qvel[ARM] = kept, 0.0
            physics.forward()
            offset = self._receptacle.offset(data, self._object)
            is_in = bool(np.abs(offset).max() < _IN)
        physics.set_state(state)
        physics.set_control(control)
        physics.forward()
        return is_in

    def _drawn(self, data: Any, random: np.random.Generator, walls: Obstacle) -> np.ndarray:
        """Poses around the mouth that point to it and are clear of the walls, (n, 4)."""
        now, target = data.qpos[ARM], data.site_xpos[self._receptacle.target][PLANE]
        axis, across = self._receptacle.axes(data)
        ahead = float(in_hand(data, data.site_xpos[self._object])[0])
        mouth = target + 0.7 * self._receptacle.before * axis
        poses = []
        for up, beside in random.uniform([_UP[0], -_BESIDE], [_UP[1], _BESIDE], (_PLACES, 2)):
            place = target + up * axis + beside * across
            angle = angle_of(mouth - place)
            poses.extend(hand_poses(random, place, GRASP + ahead, now, _POSES, angle, _TURN))
        found = np.array(poses).reshape(-1, 4)
        gaps = clearance(found, Ball.held, walls)
        return found[(gaps[:, 0] > _TOUCHING) & (gaps[:, 1:].min(axis=1) > 0)]
