"""Measurements of the arm's hand and fingers, and the constants of its control.

ahead, aside = in_hand(data, data.site_xpos["ball"])  # metres from the grasp site
target = finger_angle(0.011)  # radians, for fingertips 11 mm from the hand's middle line
"""

from typing import overload

import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import NamedFields
from limberjack.planner.arm.geometry import GEOMETRY
from limberjack.planner.settings import Settings
from limberjack.utils.arrays import Quantity

__all__ = [
    "ARM",
    "CLOSED",
    "GAIN",
    "LONGEST",
    "OPEN",
    "OPEN_ANGLE",
    "PLANE",
    "PLAY",
    "SETTINGS",
    "TIPS",
    "TIP_ASIDE",
    "TIP_REACH",
    "closing",
    "finger_angle",
    "fingers",
    "in_frame",
    "in_hand",
    "loose",
    "near",
    "outward_speed",
    "sag",
]

ARM = ["arm_root", "arm_shoulder", "arm_elbow", "arm_wrist"]
OPEN, CLOSED = -1.0, 1.0  # controls of the grasp
OPEN_ANGLE = GEOMETRY.open_angle
# Metres; position of an open fingertip in the hand.
TIP_REACH = GEOMETRY.knuckle[1] + GEOMETRY.finger[0]
TIP_ASIDE = GEOMETRY.knuckle[0] + GEOMETRY.finger[1]
TIPS = ["fingertip2", "thumbtip2"]  # geoms
PLANE = [0, 2]  # x and z of a position
LONGEST = 0.25  # metres; scale of distances, about half of the arm's reach
PLAY = 1.3  # a hold counts as perfect from 1 / PLAY on: a little slip costs nothing

GAIN = 5.0  # control per radian of the motors; see `sag`
SETTINGS = Settings(
    samples=64,
    horizon=0.5,
    knots=5,
    interval=3,
    # Contacts are no stiffer than twice the time step: at 0.01 the grasp slips.
    timestep=0.005,
    gain=GAIN,
    damping=0.0,
    noise=0.5,
)


def fingers(data: NamedFields) -> np.ndarray:
    """Angle of the fingers, (...), radians."""
    angles = data.qpos[["thumb", "finger"]]
    return (angles[..., 0] + angles[..., 1]) / 2


def closing(data: NamedFields) -> np.ndarray:
    """Angle of the fingers from fully open, (...), radians."""
    return fingers(data) - OPEN_ANGLE


def in_hand(data: NamedFields, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances of a position ahead of the grasp site and aside of it, (..., 3) -> (...) each."""
    return in_frame(place - data.site_xpos["grasp"], data.site_xmat["grasp"])


def in_frame(offset: np.ndarray, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parts of a vector along z and x of a frame, (..., 3) and (..., 9) -> (...) each."""
    along = offset[..., 0] * frame[..., 2] + offset[..., 2] * frame[..., 8]
    aside = offset[..., 0] * frame[..., 0] + offset[..., 2] * frame[..., 6]
    return along, aside


def finger_angle(width: float) -> float:
    """Angle of the fingers with their tips this far from the hand's middle line, radians."""
    ahead, aside = GEOMETRY.finger
    reach = (width - GEOMETRY.knuckle[0]) / np.hypot(ahead, aside)
    return float(np.arccos(reach) - np.arctan2(ahead, aside))


@overload
def near(distance: np.ndarray, scale: float) -> np.ndarray: ...


@overload
def near(distance: Quantity, scale: float) -> Quantity: ...


def near(distance: Quantity, scale: float) -> Quantity:
    """Closeness: 1 at no distance, a half at the scale, (...)."""
    return 1.0 / (1.0 + (distance / scale) ** 4)


def loose(physics: Physics, press: float) -> np.ndarray:
    """Cost of a grasp that presses less than it should, and slips, 0 to 0.3, (...)."""
    return 0.15 * np.maximum(press - physics.named.data.ctrl["grasp"], 0.0)


def sag(physics: Physics, gain: float) -> np.ndarray:
    """Angles by which gravity bends the arm away from its targets, (4,), radians."""
    force = physics.model.actuator_gear[:4, 0] * gain
    return physics.named.data.qfrc_bias[ARM] / force


def outward_speed(data: NamedFields, joint: str, site: str) -> np.ndarray:
    """Speed of an object away from the middle, 0 to 2 m/s, (...).

    An arm that pushes an object instead of grasping it chases it into the corners.
    """
    speed = data.qvel[joint][..., 0] * np.sign(data.site_xpos[site][..., 0])
    return np.clip(speed, 0.0, 2.0)
