"""Cheetah: a planar body on a back and a front leg runs forward, with six torques.

An episode begins on the ground, after a random pose has come to rest. The reward grows linearly
with forward speed up to 10 m/s. The task comes from https://arxiv.org/abs/1801.00690.
"""

import collections

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import _locomotion as locomotion
from limberjack.suite import base, common
from limberjack.suite.base import Seed
from limberjack.suite.base import StepKwargs as Kwargs
from limberjack.utils import arrays, containers

__all__ = ["OBSERVATIONS", "PICTURES", "SUITE", "Cheetah", "Physics", "get_model_and_assets", "run"]

_DEFAULT_TIME_LIMIT = 10  # seconds
_RUN_SPEED = 10  # metres per second; forward speed at which running is fully rewarded
_SETTLING_STEPS = 200  # physics steps, 2 seconds, in which a random pose falls and comes to rest

SUITE = containers.TaggedTasks()
PICTURES = {"run": base.Picture("side")}
OBSERVATIONS = {
    "position": base.Observed("height and rotation of the root; angles of the hinges", "m; rad"),
    "velocity": base.Observed("root x and z; rotation of the root; hinges", "m/s; rad/s; rad/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("cheetah.xml"), common.ASSETS


@SUITE.add("benchmarking")
def run(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Run forward, up to 10 m/s."""
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, Cheetah(random), time_limit, **environment_kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the cheetah."""

    def speed(self) -> arrays.Quantity:
        """Velocity of the whole body's centre of mass along x, (...), metres per second."""
        return locomotion.forward_speed(self)


class Cheetah(base.Task[Physics]):
    """Run forward as fast as possible."""

    GOAL = ("speed",)
    planner_cost = "limberjack.planner.single_stage.locomotion:Cheetah"

    def initialize_episode(self, physics: Physics) -> None:
        """Draws the angles of the legs, and lets the body fall and come to rest."""
        model = physics.model
        is_limited = model.jnt_limited == 1  # every joint has one element of qpos
        lower, upper = model.jnt_range[is_limited].T
        physics.data.qpos[is_limited] = self.random.uniform(lower, upper)
        physics.step(_SETTLING_STEPS)
        physics.data.time = 0
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Positions without the horizontal one, and velocities."""
        position = physics.data.qpos[..., 1:].copy()
        return collections.OrderedDict(position=position, velocity=physics.velocity())

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Forward speed."""
        return {"speed": locomotion.speed(physics.speed(), at_least=_RUN_SPEED)}
