"""Grips of the manipulator's ball and peg, and poses of such objects.

ready = HANDLE.ready  # the fingers' angle with which the hand comes to a peg, radians
place, frame = pose_of(physics.named.data, "peg")
grasp = grasp_place(physics.named.data, "peg", HANDLE)  # place + in_world(frame, HANDLE.place)
"""

import dataclasses
from typing import Any

import numpy as np

from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.arm.hand import SETTINGS, finger_angle, fingers, near

__all__ = [
    "BACK", "BALL", "BALL_SETTINGS", "HANDLE", "PEG_SETTINGS", "PRESS", "Grip", "Pose",
    "against_hand", "downwards", "grasp_place", "height_above_ground", "in_world", "pose_of",
]  # fmt: skip

PRESS = 0.25  # control of the grasp under which an object may slip
BACK = 0.06  # metres; how far the hand stands off before it closes in

BALL_SETTINGS = dataclasses.replace(
    SETTINGS,
    samples=40,
    # Lighter fingers are pressed through the object that they should grasp.
    armature=0.001,
    # A good plan among many bad ones is rare, and must not be lost in their mean.
    temperature=0.1,
    # Fingers that come with the right opening close soon: at most at 2 radians per second.
    tendons=True,
    cost_interval=3,
    proposal_interval=3,
    servos=True,
)
# A peg is taken between floor and fingers, where only true weights and short time steps tell. With
# no armature at all light fingers shake: a held object is 13 mm off after 0.2 seconds, else 2.5.
PEG_SETTINGS = dataclasses.replace(
    BALL_SETTINGS,
    samples=36,
    horizon=0.4,
    proposal_interval=2,
    armature=0.0002,
    timestep=0.01 / 3,
    flowing=True,
)

Pose = tuple[np.ndarray, np.ndarray]  # place (3,) and frame (9,) of a site


@dataclasses.dataclass(frozen=True)
class Grip:
    """A way to hold an object. Vectors are (x, z) in the frame of the object's site."""

    place: tuple[float, float]  # of the grasp site, metres
    # Direction of the hand; None for a ball, which may be held from any side.
    forward: tuple[float, float] | None
    width: float  # metres from the hand's middle line to a fingertip that touches the object
    slack: float  # metres by which the object may be nearer to the fingertips
    ready: float  # angle of the fingers with which the hand comes, radians
    firm: float  # the same around the object
    shut: float  # the target of that angle which holds the object

    def firmness(self, data: Any, offset: tuple[Any, Any]) -> Any:
        """1 where an object at an offset in the hand is between the closed fingers, 0 far off."""
        ahead, aside = offset
        ahead = ahead - np.clip(ahead, 0.0, self.slack)
        closed = np.clip((fingers(data) - self.ready) / (self.firm - self.ready), 0.0, 1.0)
        return near(np.hypot(ahead, aside), 0.012) * closed


# The fingertips are at these distances from the hand's middle line, in metres.
BALL = Grip((0.0, 0.0), None, 0.03, 0.015, *map(finger_angle, (0.038, 0.03, 0.011)))
# By the handle, the fingertips between pommel and guard: anywhere else they slip off. Fingers that
# press more squeeze it out.
HANDLE = Grip(
    (0.0, GEOMETRY.peg_grasp), (0.0, -1.0), 0.013, 0.0, *map(finger_angle, (0.02, 0.013, 0.01))
)


def in_world(frame: np.ndarray, vector: tuple[float, float]) -> np.ndarray:
    """A vector (x, z) of a frame (..., 9), in the world, (..., 3)."""
    x, z = vector
    return x * frame[..., 0::3] + z * frame[..., 2::3]


def grasp_place(data: Any, site: str, grip: Grip) -> np.ndarray:
    """Position at which the grasp site belongs for a grip on an object's site, (..., 3), metres."""
    return data.site_xpos[site] + in_world(data.site_xmat[site], grip.place)


def against_hand(data: Any, forward: np.ndarray) -> Any:
    """One less the cosine between the hand and a direction, (..., 3) -> (...)."""
    hand = data.site_xmat["grasp"]
    return 1.0 - forward[..., 0] * hand[..., 2] - forward[..., 2] * hand[..., 8]


def pose_of(data: Any, site: str) -> Pose:
    """Position and frame of a site."""
    return data.site_xpos[site].copy(), data.site_xmat[site].copy()


def height_above_ground(place: np.ndarray) -> np.ndarray:
    """Height of a position above the floor or a wall, (..., 3) -> (...), metres."""
    return place[..., 2] - np.maximum(np.abs(place[..., 0]) - 0.4, 0.0)


def downwards(place: np.ndarray) -> np.ndarray:
    """The direction to the floor or, beside it, the wall, (..., 3) -> (..., 3)."""
    part = np.clip((np.abs(place[..., 0]) - 0.38) / 0.05, 0.0, 1.0) * np.sign(place[..., 0])
    turned = part * np.pi / 4
    return np.stack([np.sin(turned), 0.0 * turned, -np.cos(turned)], axis=-1)
