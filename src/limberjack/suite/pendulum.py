"""Pendulum: swing up a pole with a weak motor; from https://arxiv.org/abs/1801.00690."""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import base, common
from limberjack.suite.base import Seed
from limberjack.suite.base import StepKwargs as Kwargs
from limberjack.utils import arrays, containers, rewards

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Physics",
    "SwingUp",
    "get_model_and_assets",
    "swingup",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_ANGLE_BOUND = 8  # degrees from the vertical within which the pole counts as upright
_COSINE_BOUND = float(np.cos(np.deg2rad(_ANGLE_BOUND)))

SUITE = containers.TaggedTasks()
PICTURES = {"swingup": base.Picture("fixed", seed=0)}
OBSERVATIONS = {
    "orientation": base.Observed("cosine and sine of the pole's angle from upright"),
    "velocity": base.Observed("angular velocity of the pole", "rad/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("pendulum.xml"), common.ASSETS


@SUITE.add("benchmarking")
def swingup(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swing the pole up and hold it."""
    physics, task = Physics.from_shared_xml(*get_model_and_assets()), SwingUp(random=random)
    return control.Environment(physics, task, time_limit=time_limit, **environment_kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the pole."""

    def pole_vertical(self) -> arrays.Quantity:
        """Cosine of the angle from upright, (...)."""
        return self.named.data.xmat["pole", "zz"]

    def angular_velocity(self) -> np.ndarray:
        """Velocity of the hinge, (..., 1), radians per second."""
        return self.named.data.qvel["hinge"].copy()

    def pole_orientation(self) -> np.ndarray:
        """Cosine and sine of the angle from upright, (..., 2)."""
        return self.named.data.xmat["pole", ["zz", "xz"]]


class SwingUp(base.Task[Physics]):
    """Keep the pole within 8 degrees of the vertical."""

    GOAL = ("upright",)
    planner_cost = "limberjack.planner.single_stage.swing_up:Pendulum"

    def initialize_episode(self, physics: Physics) -> None:
        """Draws any angle, at rest."""
        physics.named.data.qpos["hinge"] = self.random.uniform(-np.pi, np.pi)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Orientation and angular velocity."""
        return collections.OrderedDict(
            orientation=physics.pole_orientation(), velocity=physics.angular_velocity()
        )

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """1 while the pole is upright, else 0."""
        return {"upright": rewards.tolerance(physics.pole_vertical(), (_COSINE_BOUND, 1))}
