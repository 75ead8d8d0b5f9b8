"""Hopper: a planar body on one leg stands upright or hops forward, with four torques.

An episode begins in a random pose. The tasks come from https://arxiv.org/abs/1801.00690.
"""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import _locomotion as locomotion
from limberjack.suite import base, common
from limberjack.suite.base import Kwargs, Seed
from limberjack.suite.utils import randomizers
from limberjack.utils import arrays, containers, rewards

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Hopper",
    "Physics",
    "get_model_and_assets",
    "hop",
    "stand",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_CONTROL_TIMESTEP = 0.02  # seconds

_STAND_HEIGHT = 0.6  # metres from foot to torso at which standing is rewarded
_TALLEST = 2  # metres; more than the stretched body reaches
_HOP_SPEED = 2  # metres per second; forward speed at which hopping is fully rewarded

SUITE = containers.TaggedTasks()
# Chosen by eye: starts that look like the task.
PICTURES = {task: base.Picture("cam0", seed) for task, seed in (("stand", 0), ("hop", 3))}
OBSERVATIONS = {
    "position": base.Observed("height and rotation of the root; angles of the hinges", "m; rad"),
    "velocity": base.Observed("root x and z; rotation of the root; hinges", "m/s; rad/s; rad/s"),
    "touch": base.Observed("log(1 + force) on toe and heel", "log N"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("hopper.xml"), common.ASSETS


@SUITE.add("benchmarking")
def stand(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Stand with the torso high above the foot, with low effort."""
    return _environment(Hopper(False, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def hop(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Hop forward at 2 m/s or more."""
    return _environment(Hopper(True, random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the hopper."""

    def height(self) -> arrays.Quantity:
        """Height of the torso's centre of mass above the foot's, (...), metres."""
        centres = self.named.data.xipos
        return centres["torso", "z"] - centres["foot", "z"]

    def speed(self) -> arrays.Quantity:
        """Velocity of the whole body's centre of mass along x, (...), metres per second."""
        return locomotion.forward_speed(self)

    def touch(self) -> np.ndarray:
        """Logarithm of one plus the forces on toe and heel, (..., 2)."""
        return np.log1p(self.named.data.sensordata[["touch_toe", "touch_heel"]])


class Hopper(base.Task[Physics]):
    """Stand with low effort, or hop forward."""

    planner_cost = "limberjack.planner.single_stage.locomotion:Hopper"

    def __init__(self, hopping: bool, random: Seed = None) -> None:
        """Rewards forward speed if `hopping`, else low effort."""
        self._hopping = hopping
        self.GOAL = ("standing", "hopping") if hopping else ("standing",)
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a random pose at rest, which may pass through the floor."""
        randomizers.randomize_limited_and_rotational_joints(physics, self.random)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Positions without the horizontal one, velocities and touch sensors."""
        position, velocity = physics.data.qpos[..., 1:].copy(), physics.velocity()
        return collections.OrderedDict(position=position, velocity=velocity, touch=physics.touch())

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Height of the torso above the foot, and forward speed or low effort."""
        terms = {"standing": rewards.tolerance(physics.height(), (_STAND_HEIGHT, _TALLEST))}
        if not self._hopping:
            return terms | {"small_control": locomotion.low_effort(physics.control())}
        speed = locomotion.speed(physics.speed(), _HOP_SPEED, _HOP_SPEED / 2, value_at_margin=0.5)
        return terms | {"hopping": speed}
