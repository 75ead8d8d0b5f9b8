"""What the costs of the planar arm's tasks have in common: the hand, and paths of the joints."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from limberjack.planner.cost import Settings
from limberjack.planner.planar_ik import GRASP, direction, hand_poses_each, nudged

__all__ = [
    "ARM",
    "CLOSED",
    "LONGEST",
    "OPEN",
    "OPEN_ANGLE",
    "PLANE",
    "PLAY",
    "SETTINGS",
    "TIPS",
    "TIP_ASIDE",
    "TIP_REACH",
    "Course",
    "approaches",
    "closing",
    "finger_angle",
    "fingers",
    "in_hand",
    "lifts",
    "loose",
    "near",
    "outward_speed",
    "path",
    "paths",
    "sag",
]

ARM = ["arm_root", "arm_shoulder", "arm_elbow", "arm_wrist"]
_FINGERS = ["thumb", "finger"]
OPEN, CLOSED = -1.0, 1.0  # controls of the grasp
OPEN_ANGLE = np.radians(-10.0)  # of the fingers, at their limit
_KNUCKLE = 0.03  # metres; from the middle line of the hand to a finger's joint
_FINGER = 0.053, 0.01  # metres; from that joint to the tip, ahead and aside, at an angle of 0
TIP_REACH, TIP_ASIDE = 0.098, 0.04  # metres; where an open fingertip is in the hand
TIPS = ["fingertip2", "thumbtip2"]  # geoms
PLANE = [0, 2]  # x and z of a position
LONGEST = 0.25  # metres; what scales distances: about half of the arm's reach
_APPROACH = 0.06, 0.03, 0.0  # metres from what is taken; where a hand passes that comes straight on
PLAY = 1.3  # how much better than needed the best hold is: a little slip costs nothing


class Course(NamedTuple):
    """Straight joint paths from pose to pose; `paths` makes targets of many at once.

    Attributes:
      poses: joints to pass one after the other, (4,) each; if there are none the arm stays.
      grasp: the grasp's target at the knots; the last one holds.
      duration: knots from one pose to the next.
    """

    poses: Sequence[np.ndarray] | np.ndarray
    grasp: list[float]
    duration: int = 1


SETTINGS = Settings(
    samples=64,
    horizon=0.5,
    knots=5,
    interval=3,
    # Contacts are no stiffer than twice the time step: at 0.01 the grasp slips.
    timestep=0.005,
    gain=5.0,
    noise=0.5,
    finest=0.03,
)


def fingers(data: Any) -> Any:
    """The fingers' angle, (...), radians."""
    angles = data.qpos[_FINGERS]
    return (angles[..., 0] + angles[..., 1]) / 2


def closing(data: Any) -> Any:
    """How far the fingers have turned from fully open, (...), radians."""
    return fingers(data) - OPEN_ANGLE


def in_hand(data: Any, place: np.ndarray) -> tuple[Any, Any]:
    """How far a place is ahead of the grasp site and aside of it, (..., 3) -> (...) each."""
    offset = place - data.site_xpos["grasp"]
    frame = data.site_xmat["grasp"]
    forward = offset[..., 0] * frame[..., 2] + offset[..., 2] * frame[..., 8]
    sideways = offset[..., 0] * frame[..., 0] + offset[..., 2] * frame[..., 6]
    return forward, sideways


def finger_angle(width: float) -> float:
    """The fingers' angle that has their tips this far from the hand's middle line, radians."""
    return float(np.arccos((width - _KNUCKLE) / np.hypot(*_FINGER)) - np.arctan2(*_FINGER))


def near(distance: Any, scale: float) -> Any:
    """1 at no distance, a half at the scale, (...)."""
    return 1.0 / (1.0 + (distance / scale) ** 4)


def loose(physics: Any, press: float) -> Any:
    """What a hand that presses less than it should costs, 0 to 0.3, (...): what it holds slips."""
    return 0.15 * np.maximum(press - physics.named.data.ctrl["grasp"], 0.0)


def lifts(
    random: np.random.Generator,
    place: np.ndarray,
    angle: float,
    now: np.ndarray,
    press: float,
) -> list[Course]:
    """Ways that lift the closed hand, from a place (2,) and an angle."""
    above = place + np.array([[0.0, 0.04], [0.0, 0.12]])
    poses = np.concatenate(hand_poses_each(random, above, GRASP, now, 3, angle, 0.3))
    return [Course([pose], [press], slow) for pose in poses for slow in (1, 3)]


def approaches(poses: np.ndarray, ready: float, shut: float) -> list[Course]:
    """Ways that bring the open hand straight on to one of poses, (n, 4), in which it closes."""
    if not len(poses):
        return []
    back = -np.array(_APPROACH)[:, None] * direction(poses.sum(axis=-1))[:, None]
    found: list[Course] = []
    for line in nudged(poses[:, None], back, 0.0):
        for first, slow in ((0, 1), (1, 1), (2, 1), (2, 2), (2, 3)):
            grasp = [ready] * (1 + slow * (len(line) - first)) + [shut]
            found.append(Course(line[first:], grasp, slow))
    return found


def sag(physics: Any, gain: float) -> np.ndarray:
    """By how much gravity bends the arm away from its targets, (4,), radians."""
    force = physics.model.actuator_gear[:4, 0] * gain
    return physics.named.data.qfrc_bias[ARM] / force


def outward_speed(data: Any, joint: str, site: str) -> Any:
    """How fast an object goes away from the middle, 0 to 2 m/s, (...).

    Who pushes an object instead of taking it chases it into the corners.
    """
    speed = data.qvel[joint][..., 0] * np.sign(data.site_xpos[site][..., 0])
    return np.clip(speed, 0.0, 2.0)


def path(
    now: np.ndarray, poses: ArrayLike, knots: int, grasp: list[float], duration: int = 1
) -> np.ndarray:
    """Targets along straight joint paths, (..., knots, 5).

    Args:
      now: the arm's joints at the first knot, (4,).
      poses: the joints to pass one after the other, (..., n, 4); for an empty list the arm stays.
      knots: points of the spline.
      grasp: the grasp's control at the knots; the last one holds.
      duration: knots from one pose to the next.
    """
    # The same as `paths` makes, of many that differ in nothing but their poses.
    passed = np.asarray(poses, float)
    if passed.ndim == 1:
        passed = passed.reshape(0, 4)
    *several, count, _ = passed.shape
    stations = np.concatenate([np.broadcast_to(now, (*several, 1, 4)), passed], axis=-2)
    places = np.minimum(np.arange(knots) / duration, count)
    left = places.astype(int)
    begin, end = stations[..., left, :], stations[..., np.minimum(left + 1, count), :]
    targets = np.empty((*several, knots, 5))
    targets[..., :4] = (places - left)[:, None] * (end - begin) + begin
    targets[..., 4] = (grasp + grasp[-1:] * knots)[:knots]
    return targets


def paths(now: np.ndarray, courses: Sequence[Course], knots: int) -> np.ndarray:
    """Targets of the arm and the grasp, (len(courses), knots, 5).

    Args:
      now: the arm's joints at the first knot, (4,).
      courses: where to go from there.
      knots: points of the spline.
    """
    counts = np.array([len(course.poses) for course in courses], int)[:, None]
    stations = np.empty((len(courses), 1 + int(counts.max(initial=0)), 4))
    stations[:] = now
    targets = np.empty((len(courses), knots, 5))
    for number, (poses, grasp, _) in enumerate(courses):
        if len(poses):
            stations[number, 1 : 1 + len(poses)] = poses
        targets[number, :, 4] = (grasp + grasp[-1:] * knots)[:knots]
    durations = np.array([course.duration for course in courses])[:, None]
    places = np.minimum(np.arange(knots) / durations, counts)
    left, row = places.astype(int), np.arange(len(courses))[:, None]
    begin, end = stations[row, left], stations[row, np.minimum(left + 1, counts)]
    targets[..., :4] = (places - left)[..., None] * (end - begin) + begin
    return targets
