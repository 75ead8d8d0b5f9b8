"""The manipulator's ball and peg: how the hand holds, takes, rakes and brings each of them.

    prop = prop_of(env.task)          # Ball or Peg, which have the same methods
    ahead, aside = prop.offset(data)  # metres, from the point of the grasp
    places, angles, tilt = prop.grasps([pose_of(data, prop.name)], tilt=0.5)

Quantities are those of a batch, (N,), or of one simulation.
"""

import dataclasses

import numpy as np

from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.arm.hand import (
    ARM,
    OPEN_ANGLE,
    PLANE,
    SETTINGS,
    TIPS,
    finger_angle,
    fingers,
    in_hand,
    near,
    outward_speed,
)
from limberjack.planner.arm.kinematics import GRASP, PINCH, angle_of, hand_poses
from limberjack.planner.cost import AnyTask
from limberjack.planner.optimisers.mppi import MPPI
from limberjack.utils import arrays
from limberjack.utils.arrays import Quantity

__all__ = [
    "BACK",
    "BLADE",
    "HAND",
    "LIES",
    "PRESS",
    "Ball",
    "Peg",
    "Pose",
    "across",
    "against_hand",
    "downwards",
    "grasp_of",
    "grasp_place",
    "height_above_ground",
    "in_world",
    "is_on_arm",
    "pose_of",
    "prop_of",
]

PRESS = 0.25  # control of the grasp under which an object may slip
BACK = 0.06  # metres; how far the hand stands off before it closes in
HAND = GRASP + 0.02  # metres; from the wrist to the end of a hand on which a peg may lie
LIES = 0.08  # metres above the ground; a peg that is higher does not lie on it
BLADE = np.array([GEOMETRY.radii[-1]])  # metres; the radius of a peg

_BALL_SETTINGS = dataclasses.replace(
    SETTINGS,
    samples=40,
    # Lighter fingers are pressed through the object that they should grasp.
    armature=0.001,
    # A good plan among many bad ones is rare, and must not be lost in their mean.
    optimiser=MPPI(temperature=0.1),
    # Fingers that come with the right opening close soon: at most at 2 radians per second.
    tendons=True,
    cost_interval=3,
    proposal_interval=3,
    servos=True,
)
# A peg is taken between floor and fingers, where only true weights and short time steps tell. With
# no armature at all light fingers shake: a held object is 13 mm off after 0.2 seconds, else 2.5.
_PEG_SETTINGS = dataclasses.replace(
    _BALL_SETTINGS,
    samples=36,
    horizon=0.4,
    proposal_interval=2,
    armature=0.0002,
    timestep=0.01 / 3,
    flowing=True,
)

Pose = tuple[np.ndarray, np.ndarray]  # place (3,) and frame (9,) of a site


def pose_of(data: NamedFields, site: str) -> Pose:
    """Position and frame of a site."""
    return data.site_xpos[site].copy(), data.site_xmat[site].copy()


def in_world(frame: np.ndarray, vector: tuple[float, float]) -> np.ndarray:
    """A vector (x, z) of a frame (..., 9), in the world, (..., 3)."""
    x, z = vector
    return x * frame[..., 0::3] + z * frame[..., 2::3]


def against_hand(data: NamedFields, forward: np.ndarray) -> np.ndarray:
    """One less the cosine between the hand and a direction, (..., 3) -> (...)."""
    hand = data.site_xmat["grasp"]
    return 1.0 - forward[..., 0] * hand[..., 2] - forward[..., 2] * hand[..., 8]


def height_above_ground(place: np.ndarray) -> np.ndarray:
    """Height of a position above the floor or a wall, (..., 3) -> (...), metres."""
    return place[..., 2] - np.maximum(np.abs(place[..., 0]) - 0.4, 0.0)


def downwards(place: np.ndarray) -> np.ndarray:
    """The direction to the floor or, beside it, the wall, (..., 3) -> (..., 3)."""
    part = np.clip((np.abs(place[..., 0]) - 0.38) / 0.05, 0.0, 1.0) * np.sign(place[..., 0])
    turned = part * np.pi / 4
    return np.stack([np.sin(turned), 0.0 * turned, -np.cos(turned)], axis=-1)


@dataclasses.dataclass
class Ball:
    """The ball, which the hand may take from any side, but best from above.

    Attributes:
      joints: names of its joints: along x, along z and about y.
      place: position of the grasp site in the frame of the object's site, (x, z), metres.
      forward: direction of the hand in that frame; None for an object that is held from any side.
      width: from the hand's middle line to a fingertip that touches the object, metres.
      slack: metres by which the object may be nearer to the fingertips.
      ready, firm, shut: angles of the fingers, radians, as the hand comes and around the object;
        the target of that angle which holds the object.
      held, reach: from the wrist to the far end of the held object, and to the point of the hand
        that `grasps` puts at a place, metres.
      attempts: searches for a path after which the object is approached in another pose.
      fewest: number of poses around the object that are drawn at least where there are walls.
    """

    joints: list[str]
    name, settings = "ball", _BALL_SETTINGS
    place, forward, width, slack = (0.0, 0.0), None, 0.03, 0.015
    # The fingertips are at these distances from the hand's middle line, in metres.
    ready, firm, shut = map(finger_angle, (0.038, 0.03, 0.011))
    held, reach = GRASP + 0.022, GRASP
    attempts, fewest = 4, 1

    def offset(self, data: NamedFields) -> tuple[np.ndarray, np.ndarray]:
        """Distances of the ball ahead and aside of the point of the grasp, (N,) each, metres."""
        return in_hand(data, data.site_xpos["ball"])

    def misalignment(self, data: NamedFields) -> np.ndarray:
        """One less the cosine between the hand and straight down, 0 up to 20 degrees, (...)."""
        return np.maximum(against_hand(data, downwards(data.site_xpos["ball"])) - 0.06, 0.0)

    def firmness(self, data: NamedFields, offset: tuple[Quantity, Quantity]) -> np.ndarray:
        """1 where the ball is right between the closed fingers, 0 far from there, (N,)."""
        return _enclosed(data, self, offset)

    def opening(self, offset: tuple[Quantity, Quantity]) -> float:
        """The fingers' angle with which the hand comes, radians."""
        return self.ready

    def chased(self, data: NamedFields) -> np.ndarray:
        """Cost of the motion of the ball while it is not held, (N,)."""
        return outward_speed(data, self.joints[0], "ball")

    def swung(self, data: NamedFields) -> list[np.ndarray]:
        """Costs of the motion of the ball while it is held: none."""
        return []

    def gap(self, data: NamedFields) -> np.ndarray:
        """Distance of the ball from the target, (N,), metres."""
        return arrays.norm(data.site_xpos["ball"] - data.site_xpos["target_ball"])

    def rake_goal(self, data: NamedFields) -> float:
        """Position in reach to which the ball is raked: x, metres."""
        return 0.0

    def poses_at_target(
        self, data: NamedFields, random: np.random.Generator, count: int
    ) -> np.ndarray:
        """Arm joints that have the ball at the target, (n, 4), n <= count."""
        place = data.site_xpos["target_ball"][PLANE]
        return hand_poses(random, place, GRASP, data.qpos[ARM], count)

    def grasps(self, objects: list[Pose], tilt: float) -> tuple[np.ndarray, np.ndarray, float]:
        """For each pose the place of the hand, (n, 2), its angle, (n,), and the play of that.

        The hand may turn by `tilt` radians around objects with a direction.
        """
        places = np.array([place for place, _ in objects])
        return places[:, PLANE], angle_of(downwards(places)[:, PLANE]), 0.8


@dataclasses.dataclass
class Peg:
    """The peg, which the hand takes by its handle, from straight on; attributes as of `Ball`."""

    joints: list[str]
    name, settings = "peg", _PEG_SETTINGS
    # By the handle, the fingertips between pommel and guard: anywhere else they slip off. Fingers
    # that press more squeeze it out.
    place, forward, width, slack = (0.0, GEOMETRY.peg_grasp), (0.0, -1.0), 0.013, 0.0
    ready, firm, shut = map(finger_angle, (0.02, 0.013, 0.01))
    held, reach = GRASP + GEOMETRY.peg, PINCH
    attempts, fewest = 8, 8

    # Radians that a peg at the target may lean about the point between its middle and its tip,
    # which are then 0.05 sin(lean / 2) off each: up to 0.4 the reward is 1, at 0.8 it is 0.6. As
    # paths are found by chance, straight ones are tried twice.
    _leans = 0.02, 0.02, 0.4, 0.8
    _lean = 0  # which of these it has

    def offset(self, data: NamedFields) -> tuple[np.ndarray, np.ndarray]:
        """Offset of the pinch from the fingertips, about which a hand may turn, (N,) each."""
        ahead, aside = in_hand(data, data.site_xpos["peg_pinch"])
        return ahead - (PINCH - GRASP), aside

    def misalignment(self, data: NamedFields) -> np.ndarray:
        """One less the cosine between the hand and the peg, (...)."""
        return against_hand(data, _forward(data.site_xmat["peg"]))

    def firmness(self, data: NamedFields, offset: tuple[Quantity, Quantity]) -> np.ndarray:
        """1 where the handle is right between the closed fingers, and along the hand, (N,)."""
        return _enclosed(data, self, offset) * near(self.misalignment(data), 0.15)

    def opening(self, offset: tuple[Quantity, Quantity]) -> np.ndarray:
        """The fingers' angle with which the hand comes, or releases a peg too deep in it, (N,)."""
        ahead, aside = offset
        # A guard that is no more than 12 mm behind the fingertips keeps a peg in the hand.
        is_deep = (ahead < -0.012) & (ahead > -BACK) & (np.abs(aside) < BACK / 2)
        return np.where(is_deep, OPEN_ANGLE, self.ready)

    def chased(self, data: NamedFields) -> np.ndarray:
        """Cost of the peg's motion while it is not held; a hand that comes too fast kicks it."""
        speed = arrays.norm(data.qvel[self.joints][..., :2])
        lies = height_above_ground(data.site_xpos["peg"]) < LIES
        return outward_speed(data, self.joints[0], "peg") + np.minimum(speed, 2.0) * lies

    def swung(self, data: NamedFields) -> list[np.ndarray]:
        """Costs of the speed and the spin of a held peg, which may slip, (N,) each."""
        velocity = data.qvel[self.joints]
        speed, spin = arrays.norm(velocity[..., :2]), np.abs(velocity[..., 2])
        return [0.5 * np.maximum(speed - 3.0, 0.0), 0.05 * np.maximum(spin - 10.0, 0.0)]

    def gap(self, data: NamedFields) -> np.ndarray:
        """Mean distance of the peg's middle and tip from theirs at the target, (N,), metres."""
        places = data.site_xpos
        gaps = [arrays.norm(places[s] - places[f"target_{s}"]) for s in ("peg", "peg_tip")]
        return (gaps[0] + gaps[1]) / 2

    def rake_goal(self, data: NamedFields) -> float:
        """Position in reach: x, metres; the hand needs more room on the handle's side."""
        return 0.12 if _forward(data.site_xmat["peg"])[0] > 0 else -0.12

    def lean(self) -> None:
        """Tries another angle of the peg at the target."""
        self._lean = (self._lean + 1) % len(self._leans)

    def poses_at_target(
        self, data: NamedFields, random: np.random.Generator, count: int
    ) -> np.ndarray:
        """Arm joints that have the peg at the target, straight or leaning, (n, 4), n <= count."""
        middle, frame = pose_of(data, "target_peg")
        between = 0.0, -0.025  # metres in the frame of a peg: it turns about this point
        place = (middle + in_world(frame, between))[PLANE]
        forward = GRASP + self.place[1] - between[1]
        wanted = angle_of(_forward(frame)[PLANE]), self._leans[self._lean]
        now = data.qpos[ARM]
        return hand_poses(random, place, forward, now, count, *wanted, width=self.width)

    def grasps(self, objects: list[Pose], tilt: float) -> tuple[np.ndarray, np.ndarray, float]:
        """For each pose the place of the hand, (n, 2), its angle, (n,), and the play of that."""
        places, angles = zip(*map(grasp_of, objects), strict=True)
        return np.array(places), np.array(angles), min(tilt, 0.3)  # more turned, a peg slips


def grasp_place(data: NamedFields, site: str, prop: type[Ball] | type[Peg]) -> np.ndarray:
    """Position at which the grasp site belongs for an object of this site, (..., 3), metres."""
    return data.site_xpos[site] + in_world(data.site_xmat[site], prop.place)


def prop_of(task: AnyTask) -> Ball | Peg:
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
    return place + 0.003 * abs(flat) * down, float(angle_of(forward)) + 0.25 * flat


def is_on_arm(data: NamedFields) -> bool:
    """Whether the peg of a single simulation is within 15 mm of the arm, high above the ground."""
    if height_above_ground(data.site_xpos["peg"]) <= 0.12:
        return False
    peg = Obstacle(data.site_xpos[["peg_grasp", "peg_tip"]][None][..., PLANE], BLADE)
    return bool(clearance(data.qpos[ARM][None], HAND, peg)[0, 0] < 0.015)


def across(data: NamedFields, turn: Quantity) -> np.ndarray:
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
    return in_world(frame, Peg.forward)


def _enclosed(data: NamedFields, prop: Ball | Peg, offset: tuple[Quantity, Quantity]) -> np.ndarray:
    """1 where an object at an offset in the hand is between the closed fingers, 0 far off, (N,)."""
    ahead, aside = offset
    ahead = ahead - np.clip(ahead, 0.0, prop.slack)
    closed = np.clip((fingers(data) - prop.ready) / (prop.firm - prop.ready), 0.0, 1.0)
    return near(np.hypot(ahead, aside), 0.012) * closed
