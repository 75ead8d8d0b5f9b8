"""Scenes with boxes and the hand at given places, for the tests of the stacker's cost."""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_poses
from limberjack.planner.stacker.tower import HALF

__all__ = ["DOWN", "TOP", "place_boxes", "point_hand", "scene"]

DOWN = angle_of(np.array([0.0, -1.0]))  # the hand's angle, radians
TOP = 3 * HALF  # metres; height of the middle of a box on another one


def scene(
    places: list[tuple[float, float]], level: int = 1, target: float = 0.0, seconds: float = 1.0
) -> tuple[Any, Any]:
    """The task and physics of resting boxes at x and z, as many as places, and the hand far above.

    Args:
      places: of the boxes' middles, metres.
      level: boxes below the target.
      target: its x, metres.
      seconds: since the episode's start.
    """
    env = suite.load("stacker", f"stack_{len(places)}", {"random": 1})
    env.reset()
    physics = env.physics
    physics.named.model.body_pos["target"] = target, 0.001, HALF * (2 * level + 1)
    physics.data.time = seconds
    place_boxes(physics, places)
    point_hand(physics, 0.2, 0.35)
    return env.task, physics


def place_boxes(
    physics: Any, places: list[tuple[float, float]], angle: float = 0.0, first: int = 0
) -> None:
    """Puts boxes, from the `first` on, at x and z, turned by an angle in radians, at rest."""
    for number, (x, z) in enumerate(places, first):
        joints = [f"box{number}_{axis}" for axis in "xzy"]
        physics.named.data.qpos[joints] = x, z, angle
    physics.data.qvel[:] = 0.0
    physics.forward()


def point_hand(physics: Any, x: float, z: float, closed: float = 0.0) -> None:
    """Points the hand down with its grasp site at x and z; fingers closed by so many radians."""
    data, place = physics.named.data, np.array([x, z])
    found = hand_poses(np.random.default_rng(0), place, GRASP, np.zeros(4), 1, DOWN, 0.0)
    data.qpos[ARM] = found[0]
    data.qpos[["thumb", "finger"]] = OPEN_ANGLE + closed
    data.qvel[:] = 0.0
    physics.forward()
