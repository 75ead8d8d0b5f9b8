"""`Ball`: the manipulator's ball as an object to grasp.

    ball = Ball(task.object_joints)
    ahead, aside = ball.offset(data)  # metres, from the point of the grasp
    poses = ball.poses_around([pose_of(data, "ball")], now, random, count=4)

`peg.Peg` has the same methods. Quantities are those of a batch, (N,), or of one simulation.
"""

from typing import Any

import numpy as np

from limberjack.planner.arm.hand import ARM, PLANE, in_hand, outward_speed
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_poses, hand_poses_each
from limberjack.planner.manipulator.grips import (
    BALL,
    BALL_SETTINGS,
    Pose,
    against_hand,
    downwards,
    grasp_place,
)
from limberjack.utils import arrays

__all__ = ["HELD", "Ball"]

HELD = GRASP + 0.022  # metres; from the wrist to the far end of a held ball
_LENIENT = 0.06  # one less the cosine; how far from upright a hand that takes a ball may be
_TILT = 0.8  # radians; the same for the poses that are drawn


class Ball:
    """The ball, which the hand may take from any side, but best from above."""

    name, grip, settings = "ball", BALL, BALL_SETTINGS

    def __init__(self, joints: list[str]) -> None:
        """Takes the names of the ball's joints: along x, along z and about y."""
        self.joints = joints

    def offset(self, data: Any) -> tuple[Any, Any]:
        """Distances of the ball ahead and aside of the point of the grasp, (N,) each, metres."""
        return in_hand(data, grasp_place(data, self.name, self.grip))

    def misalignment(self, data: Any) -> Any:
        """One less the cosine between the hand and straight down, 0 near enough, (...)."""
        return np.maximum(against_hand(data, downwards(data.site_xpos["ball"])) - _LENIENT, 0.0)

    def firmness(self, data: Any, offset: tuple[Any, Any]) -> Any:
        """1 where the ball is right between the closed fingers, 0 far from there, (N,)."""
        return self.grip.firmness(data, offset)

    def opening(self, offset: tuple[Any, Any]) -> float:
        """The fingers' angle with which the hand comes, radians."""
        return self.grip.ready

    def chased(self, data: Any) -> Any:
        """Cost of the motion of the ball while it is not held, (N,)."""
        return outward_speed(data, self.joints[0], self.name)

    def swung(self, data: Any) -> list[np.ndarray]:
        """Costs of the motion of the ball while it is held: none."""
        return []

    def gap(self, data: Any) -> Any:
        """Distance of the ball from the target, (N,), metres."""
        return arrays.norm(data.site_xpos["ball"] - data.site_xpos["target_ball"])

    def rake_goal(self, data: Any) -> float:
        """Position in reach to which the ball is raked: x, metres."""
        return 0.0

    def poses_at_target(self, data: Any, random: np.random.Generator, count: int) -> np.ndarray:
        """Arm joints that have the ball at the target, (n, 4), n <= count."""
        place, now = data.site_xpos["target_ball"][PLANE], data.qpos[ARM]
        return hand_poses(random, place, GRASP, now, count)

    def poses_around(
        self,
        objects: list[Pose],
        now: np.ndarray,
        random: np.random.Generator,
        count: int,
        back: float = 0.0,
        tilt: float = 0.5,
    ) -> list[np.ndarray]:
        """Arm joints that have the hand around the ball, (n, 4) for each of its poses, n <= count.

        Args:
          objects: the poses.
          now: the arm's current joints, (4,).
          random: draws the redundancy.
          count: largest number for each pose.
          back: distance that the hand keeps, metres.
          tilt: radians by which a hand may deviate from an object's direction; a ball has none.
        """
        places = np.array([place for place, _ in objects])
        down = angle_of(downwards(places)[:, PLANE])
        clear = {"width": self.grip.width, "slack": 1.5 * self.grip.slack}
        each = places[:, PLANE], GRASP + back, now, count
        return hand_poses_each(random, *each, down, _TILT, **clear)
