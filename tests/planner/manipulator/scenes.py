"""Scenes with a ball or a peg at a given place, for the tests of the costs."""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.planner import cost_for
from limberjack.planner.arm.hand import ARM
from limberjack.planner.manipulator.props import Pose

__all__ = ["lying_peg", "scene"]


def scene(task: str, seed: int, arm: list[float], prop: list[float]) -> tuple[Any, Any]:
    """A cost and the physics of an arm that keeps still, with the prop at a place (x, z, angle)."""
    env = suite.load("manipulator", task, task_kwargs={"random": seed})
    env.reset()
    physics, data = env.physics, env.physics.named.data
    data.qpos[ARM], data.qpos[env.task.object_joints] = arm, prop
    data.qvel[:] = 0.0
    physics.forward()
    return cost_for(env.task), physics


def lying_peg(tip_to: float) -> Pose:
    """A peg on the floor, its tip to the left or the right; it leans on its guard."""
    lean = tip_to * np.radians(-76.4)
    frame = np.array([np.cos(lean), 0, np.sin(lean), 0, 1, 0, -np.sin(lean), 0, np.cos(lean)])
    return np.array([0.1, 0.0, 0.017]), frame
