"""Reacher: touch a target with a planar arm; from https://arxiv.org/abs/1801.00690."""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import base, common
from limberjack.suite.base import Seed
from limberjack.suite.base import StepKwargs as Kwargs
from limberjack.suite.utils import randomizers
from limberjack.utils import arrays, containers, rewards

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Physics",
    "Reacher",
    "easy",
    "get_model_and_assets",
    "hard",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_BIG_TARGET = 0.05  # metres; radius
_SMALL_TARGET = 0.015  # metres; radius
_TARGET_DISTANCES = (0.05, 0.2)  # metres from the shoulder; the finger reaches 0.24

SUITE = containers.TaggedTasks()
PICTURES = dict.fromkeys(("easy", "hard"), base.Picture("fixed", seed=1))
OBSERVATIONS = {
    "position": base.Observed("angles of shoulder and wrist", "rad"),
    "to_target": base.Observed("x and y of the vector from the finger to the target", "m"),
    "velocity": base.Observed("angular velocities of shoulder and wrist", "rad/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("reacher.xml"), common.ASSETS


@SUITE.add("benchmarking", "easy")
def easy(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Reach a target with a radius of 5 cm."""
    return _environment(Reacher(_BIG_TARGET, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def hard(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Reach a target with a radius of 1.5 cm."""
    return _environment(Reacher(_SMALL_TARGET, random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit=time_limit, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the finger."""

    def finger_to_target(self) -> np.ndarray:
        """Vector from the finger to the target in the plane, (..., 2), metres."""
        positions = self.named.data.geom_xpos
        return positions["target", :2] - positions["finger", :2]

    def finger_to_target_dist(self) -> arrays.Quantity:
        """Distance between the centres of finger and target in the plane, (...), metres."""
        return arrays.norm(self.finger_to_target())


class Reacher(base.Task[Physics]):
    """Touch the target with the finger."""

    GOAL = ("at_target",)
    planner_cost = "limberjack.planner.single_stage.reaching:Reacher"
    EPISODE_FIELDS = ("geom_size", "geom_pos")  # the target's

    def __init__(self, target_size: float, random: Seed = None) -> None:
        """Creates the task; `target_size` is the radius of the target, metres."""
        self._target_size = target_size
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a pose at rest and the target's position."""
        target = physics.named.model
        target.geom_size["target", "x"] = self._target_size
        randomizers.randomize_limited_and_rotational_joints(physics, self.random)
        angle = self.random.uniform(0, 2 * np.pi)
        distance = self.random.uniform(*_TARGET_DISTANCES)
        target.geom_pos["target", "x"] = distance * np.sin(angle)
        target.geom_pos["target", "y"] = distance * np.cos(angle)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Pose, vector to the target and velocities."""
        return collections.OrderedDict(
            position=physics.position(),
            to_target=physics.finger_to_target(),
            velocity=physics.velocity(),
        )

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """1 while finger and target overlap, else 0."""
        sizes = physics.named.model.geom_size
        radii = sizes["target", "x"] + sizes["finger", "x"]
        return {"at_target": rewards.tolerance(physics.finger_to_target_dist(), (0, radii))}
