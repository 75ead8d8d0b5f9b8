"""Scenes with a peg that lies somewhere, for the tests of what is done about it."""

from typing import Any

from limberjack import suite
from limberjack.planner import cost_for
from limberjack.planner.arm.hand import ARM

__all__ = ["peg_scene"]


def peg_scene(task: str, seed: int, arm: list[float], peg: list[float]) -> tuple[Any, Any]:
    """A cost and the physics of an arm that keeps still, with a peg that lies somewhere."""
    env = suite.load("manipulator", task, task_kwargs={"random": seed})
    env.reset()
    physics, data = env.physics, env.physics.named.data
    data.qpos[ARM], data.qpos[env.task.object_joints] = arm, peg
    data.qvel[:] = 0.0
    physics.forward()
    return cost_for(env.task), physics
