"""`Ball` and `Peg`: the manipulator's props as objects to grasp.

    prop = prop_of(env.task)         # Ball or Peg, which have the same methods
    ahead, aside = prop.offset(data) # metres, from the point of the grasp
    places, angles, tilt = prop.grasps([pose_of(data, prop.name)], tilt=0.5)

Quantities are those of a batch, (N,), or of one simulation.
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, PLANE, TIPS, in_hand, near, outward_speed
from limberjack.planner.arm.kinematics import GRASP, PINCH, angle_of, hand_poses
from limberjack.planner.manipulator.grips import (
    BACK,
    BALL,
    BALL_SETTINGS,
    HANDLE,
    PEG_SETTINGS,
    Pose,
    against_hand,
    downwards,
    grasp_place,
    height_above_ground,
    in_world,
    pose_of,
)
from limberjack.utils import arrays

__all__ = ["BLADE", "HAND", "LIES", "Ball", "Peg", "across", "grasp_of", "is_on_arm", "prop_of"]

HAND = GRASP + 0.02  # metres; from the wrist to the end of a hand on which a peg may lie
LIES = 0.08  # metres above the ground; a peg that is higher does not lie on it
BLADE = np.array([GEOMETRY.radii[-1]])  # metres; the radius of a peg


@dataclasses.dataclass
class Ball:
    """The ball, which the hand may take from any side, but best from above.

    Attributes:
      joints: names of its joints: along x, along z and about y.
      held, reach: from the wrist to the far end of the held object, and to the point of the hand
        that `grasps` puts at a place, metres.
    """

    joints: list[str]
    name, grip, settings = "ball", BALL, BALL_SETTINGS
    held, reach = GRASP + 0.022, GRASP

    def offset(self, data: Any) -> tuple[Any, Any]:
        """Distances of the ball ahead and aside of the point of the grasp, (N,) each, metres."""
        return in_hand(data, grasp_place(data, self.name, self.grip))

    def misalignment(self, data: Any) -> Any:
        """One less the cosine between the hand and straight down, 0 up to 20 degrees, (...)."""
        return np.maximum(against_hand(data, downwards(data.site_xpos["ball"])) - 0.06, 0.0)

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

    def grasps(self, objects: list[Pose], tilt: float) -> tuple[np.ndarray, Any, float]:
        """For each pose the place of the hand, (n, 2), its angle, (n,), and the play of that.

        The hand may turn by `tilt` radians around objects with a direction.
        """
        places = np.array([place for place, _ in objects])
        return places[:, PLANE], angle_of(downwards(places)[:, PLANE]), 0.8


@dataclasses.dataclass
class Peg:
    """The peg, which the hand takes by its handle, from straight on; attributes as of `Ball`."""

    joints: list[str]
    name, grip, settings = "peg", HANDLE, PEG_SETTINGS
    held, reach = GRASP + GEOMETRY.peg, PINCH

    # Radians that a peg at the target may lean about the point between its middle and its tip,
    # which are then 0.05 sin(lean / 2) off each: up to 0.4 the reward is 1, at 0.8 it is 0.6. As
    # paths are found by chance, straight ones are tried twice.
    _leans = 0.02, 0.02, 0.4, 0.8
    _lean = 0  # which of these it has

    def offset(self, data: Any) -> tuple[Any, Any]:
        """Offset of the pinch from the fingertips, about which a hand may turn, (N,) each."""
        ahead, aside = in_hand(data, data.site_xpos["peg_pinch"])
        return ahead - (PINCH - GRASP), aside

    def misalignment(self, data: Any) -> Any:
        """One less the cosine between the hand and the peg, (...)."""
        return against_hand(data, _forward(data.site_xmat["peg"]))

    def firmness(self, data: Any, offset: tuple[Any, Any]) -> Any:
        """1 where the handle is right between the closed fingers, and along the hand, (N,)."""
        return self.grip.firmness(data, offset) * near(self.misalignment(data), 0.15)

    def opening(self, offset: tuple[Any, Any]) -> np.ndarray:
        """The fingers' angle with which the hand comes, or releases a peg too deep in it, (N,)."""
        ahead, aside = offset
        # A guard that is no more than 12 mm behind the fingertips keeps a peg in the hand.
        is_deep = (ahead < -0.012) & (ahead > -BACK) & (np.abs(aside) < BACK / 2)
        return np.where(is_deep, OPEN_ANGLE, HANDLE.ready)

    def chased(self, data: Any) -> Any:
        """Cost of the peg's motion while it is not held; a hand that comes too fast kicks it."""
        speed = arrays.norm(data.qvel[self.joints][..., :2])
        lies = height_above_ground(data.site_xpos["peg"]) < LIES
        return outward_speed(data, self.joints[0], self.name) + np.minimum(speed, 2.0) * lies

    def swung(self, data: Any) -> list[np.ndarray]:
        """Costs of the speed and the spin of a held peg, which may slip, (N,) each."""
        velocity = data.qvel[self.joints]
        speed, spin = arrays.norm(velocity[..., :2]), np.abs(velocity[..., 2])
        return [0.5 * np.maximum(speed - 3.0, 0.0), 0.05 * np.maximum(spin - 10.0, 0.0)]

    def gap(self, data: Any) -> Any:
        """Mean distance of the peg's middle and tip from theirs at the target, (N,), metres."""
        places = data.site_xpos
        gaps = [arrays.norm(places[s] - places[f"target_{s}"]) for s in ("peg", "peg_tip")]
        return (gaps[0] + gaps[1]) / 2

    def rake_goal(self, data: Any) -> float:
        """Position in reach: x, metres; the hand needs more room on the handle's side."""
        return 0.12 if _forward(data.site_xmat["peg"])[0] > 0 else -0.12

    def lean(self) -> None:
        """Tries another angle of the peg at the target."""
        self._lean = (self._lean + 1) % len(self._leans)

    def poses_at_target(self, data: Any, random: np.random.Generator, count: int) -> np.ndarray:
        """Arm joints that have the peg at the target, straight or leaning, (n, 4), n <= count."""
        middle, frame = pose_of(data, "target_peg")
        between = 0.0, -0.025  # metres in the frame of a peg: it turns about this point
        place = (middle + in_world(frame, between))[PLANE]
        forward = GRASP + self.grip.place[1] - between[1]
        wanted = angle_of(_forward(frame)[PLANE]), self._leans[self._lean]
        now, width = data.qpos[ARM], self.grip.width
        return hand_poses(random, place, forward, now, count, *wanted, width=width)

    def grasps(self, objects: list[Pose], tilt: float) -> tuple[np.ndarray, Any, float]:
        """For each pose the place of the hand, (n, 2), its angle, (n,), and the play of that."""
        grasps = [grasp_of(peg) for peg in objects]
        places, angles = np.array([g[0] for g in grasps]), np.array([g[1] for g in grasps])
        return places, angles, min(tilt, 0.3)  # a peg slips from a hand that is turned more


def prop_of(task: Any) -> Ball | Peg:
    """The prop of a `manipulator.Bring` task."""
    joints = task.object_joints
    return Peg(joints) if joints[0] == "peg_x" else Ball(joints)


def grasp_of(peg: Pose) -> tuple[np.ndarray, float]:
    """Position of the hand's pinch site for the grasp of a peg, (2,), and the hand's angle."""
    middle, frame = peg
    place = (middle + in_world(frame, (0.0, 0.034)))[PLANE]
    forward, down = _forward(frame)[PLANE], downwards(middle)[PLANE]
    # Along a peg that lies flat a finger would be in the floor: the hand comes from above.
    flat = float(forward[0] * down[1] - forward[1] * down[0])
    return place + 0.003 * abs(flat) * down, angle_of(forward) + 0.25 * flat


def is_on_arm(data: Any) -> bool:
    """Whether the peg of a single simulation is within 15 mm of the arm, high above the ground."""
    if height_above_ground(data.site_xpos["peg"]) <= 0.12:
        return False
    peg = Obstacle(data.site_xpos[["peg_grasp", "peg_tip"]][None][..., PLANE], BLADE)
    return bool(clearance(data.qpos[ARM][None], HAND, peg)[0, 0] < 0.015)


def across(data: Any, turn: Any) -> np.ndarray:
    """Cost of fingertips near a peg that a turned hand is not around, (N,): they would pin it.

    The turn is one less the cosine between hand and peg, (N,).
    """
    start, end = data.site_xpos["peg_grasp"], data.site_xpos["peg_tip"]
    along, offset = (end - start)[..., None, :], data.geom_xpos[TIPS] - start[..., None, :]
    part = np.clip((offset * along).sum(axis=-1) / GEOMETRY.peg**2, 0.0, 1.0)
    gap = arrays.norm(offset - part[..., None] * along)
    crossed = np.clip(10.0 * turn - 1.0, 0.0, 1.0)
    return 10.0 * crossed * np.maximum(0.04 - gap, 0.0).sum(axis=-1)


def _forward(frame: np.ndarray) -> np.ndarray:
    """Direction of a hand that holds a peg of this frame, (..., 9) -> (..., 3)."""
    assert HANDLE.forward is not None
    return in_world(frame, HANDLE.forward)
