"""`Approach`: poses of the hand around an object, and paths to them around a receptacle's walls.

    approach = Approach(prop_of(task))
    approach.set_walls(receptacle.walls(physics))
    (poses,) = approach.poses_around([pose_of(data, "peg")], now, random, count=12)  # (n, 4)
    path = approach.path_to_object(data, few=False)  # None if none is found

Poses keep clear of the walls. Paths lead to before the object, to where a fingertip rakes it, or to
where a peg falls off the arm.
"""

import numpy as np

from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.collision import NOTHING, Obstacle, clearance
from limberjack.planner.arm.hand import ARM, PLANE
from limberjack.planner.arm.kinematics import (
    GRASP,
    direction,
    hand_poses,
    hand_poses_each,
    nudged,
)
from limberjack.planner.arm.path import Path
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.props import BACK, BLADE, HAND, Ball, Peg, Pose, pose_of
from limberjack.planner.manipulator.raking import Spot

__all__ = ["GOALS", "STRETCHED", "TOUCHING", "Approach", "few_of"]

GOALS = 96  # poses in which a path may end
TOUCHING = -0.004  # metres; fingers may be so near to walls that they touch them
STRETCHED = np.array([np.pi, 0.5, 0.5, 0.5])  # radians; joints of an arm on which no peg lies
_FEW = 12  # poses of another attempt


def few_of(random: np.random.Generator, poses: np.ndarray) -> np.ndarray:
    """Twelve of the poses (n, 4), for another attempt."""
    return poses[random.permutation(len(poses))[:_FEW]]


class Approach:
    """Poses and paths to an object; see the module's docstring."""

    def __init__(self, prop: Ball | Peg) -> None:
        self.prop = prop
        self.walls = NOTHING
        self.draws = np.random.default_rng(0)  # for searches, other than the planner's stream

    def set_walls(self, walls: Obstacle) -> None:
        """Keeps clear of a receptacle's walls from now on."""
        self.walls = walls

    def poses_around(
        self,
        objects: list[Pose],
        now: np.ndarray,
        random: np.random.Generator,
        count: int,
        back: float = 0.0,
        tilt: float = 0.5,
    ) -> list[np.ndarray]:
        """Arm joints around each pose of the object with the hand clear of the walls, (n, 4).

        The hand keeps `back` metres away. It is straight on to a peg to within `tilt` radians.
        """
        prop, is_walled = self.prop, self.walls is not NOTHING
        wanted = max(count, prop.fewest) if is_walled else count
        drawn = 2 * wanted if is_walled else wanted  # some are in the walls
        places, angles, play = prop.grasps(objects, tilt)
        each = places, prop.reach + back, now, drawn, angles, play
        clear = {"width": prop.width, "slack": 1.5 * prop.slack}
        found = hand_poses_each(random, *each, **clear)
        left = [poses[self.is_clear(poses)] for poses in found]
        return [poses[:: max(1, len(poses) // wanted)][:count] for poses in left]

    def is_clear(self, poses: np.ndarray) -> np.ndarray:
        """In which poses (n, 4) the hand is not in the walls, (n,)."""
        if self.walls is NOTHING:
            return np.ones(len(poses), bool)
        return clearance(poses, HAND, self.walls)[:, 0] > TOUCHING

    def is_fast(self, data: NamedFields) -> bool:
        """Whether the object, at over 1 m/s, will soon be elsewhere than where a path leads."""
        return bool(np.abs(data.qvel[self.prop.joints[:2]]).max() > 1.0)

    def path_to_object(self, data: NamedFields, few: bool) -> Path | None:
        """The arm's path to before the object, the shortest to many goals or to a few."""
        now, is_ball = data.qpos[ARM], isinstance(self.prop, Ball)
        goals = self._around_ball(data) if is_ball else self._around_peg(data)
        if few:
            goals = few_of(self.draws, goals)
        if is_ball:
            return find_path(now, goals, HAND, self.walls)
        # The peg is an obstacle too: on its path the hand would push it away. If no path leads to
        # well before the peg, one may end 1 cm before it.
        path = None
        for back, start in ((BACK, "peg_grasp"), (0.01, "peg")):
            peg = data.site_xpos[[start, "peg_tip"]][None][..., PLANE]
            ends = np.concatenate([self.walls.ends, peg])
            around = Obstacle(ends, np.append(self.walls.radii, BLADE))
            before = nudged(goals, -back * direction(goals.sum(axis=-1)), 0.0)
            path = path or find_path(now, before, HAND, around, close=True)
        return path

    def _around_ball(self, data: NamedFields) -> np.ndarray:
        """Arm joints before the ball, or where a rolling ball can be taken, (n, 4)."""
        now, random = data.qpos[ARM], self.draws
        if not self.is_fast(data):
            return self.poses_around([pose_of(data, "ball")], now, random, GOALS, BACK)[0]
        places = [np.array([x, 0.04]) for x in random.uniform(-0.3, 0.3, 16)]  # metres
        found = np.concatenate([hand_poses(random, p, GRASP, now, 8, np.pi, 0.8) for p in places])
        takes = found[self.is_clear(found)]
        return nudged(takes, -BACK * direction(takes.sum(axis=-1)), 0.0)

    def _around_peg(self, data: NamedFields) -> np.ndarray:
        """Arm joints in which the walls leave the hand room to take the peg, (n, 4)."""
        return self.poses_around([pose_of(data, "peg")], data.qpos[ARM], self.draws, GOALS)[0]

    def path_to_spot(self, data: NamedFields, spot: Spot, goal: float) -> Path | None:
        """The arm's path to the spot where a peg is raked to a goal (x, metres), or to above it."""
        # From above the spot a fingertip reaches it where the hand would be in a wall.
        for higher in (0.0, 0.03, 0.06):
            poses = spot.poses(data, goal, self.walls, higher)
            path = find_path(data.qpos[ARM], poses, HAND, self.walls, close=True)
            if path is not None:
                return path
        return None

    def path_to_room(self, data: NamedFields) -> Path | None:
        """A path that stretches the arm, so that a peg falls off it."""
        room = self.draws.uniform(-STRETCHED, STRETCHED, (8, 4))
        return find_path(data.qpos[ARM], room, HAND, self.walls)
