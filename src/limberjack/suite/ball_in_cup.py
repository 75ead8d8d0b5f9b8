"""Ball in cup: swing a ball on a string into a cup; from https://arxiv.org/abs/1801.00690."""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import base, common
from limberjack.suite.base import Kwargs, Seed
from limberjack.utils import arrays, containers

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "BallInCup",
    "Physics",
    "catch",
    "get_model_and_assets",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_CONTROL_TIMESTEP = 0.02  # seconds

SUITE = containers.TaggedTasks()
PICTURES = {"catch": base.Picture("cam0", seed=1)}
OBSERVATIONS = {
    "position": base.Observed("displacements from the model's pose: cup x, z; ball x, z", "m"),
    "velocity": base.Observed("velocities: cup x, z; ball x, z", "m/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("ball_in_cup.xml"), common.ASSETS


@SUITE.add("benchmarking", "easy")
def catch(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Catch the ball and keep it in the cup."""
    physics, task = Physics.from_shared_xml(*get_model_and_assets()), BallInCup(random)
    kwargs = environment_kwargs or {}
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs)


class Physics(mujoco.Physics):
    """Measurements of ball and cup, in the x-z plane."""

    def ball_to_target(self) -> np.ndarray:
        """Vector from the ball to the middle of the cup: x and z, (..., 2), metres."""
        data = self.named.data
        return data.site_xpos["target", ["x", "z"]] - data.xpos["ball", ["x", "z"]]

    def in_target(self) -> arrays.Quantity:
        """1 where the whole ball is in the cup, else 0, (...)."""
        model = self.named.model
        room = model.site_size["target", ["x", "z"]] - model.geom_size["ball", ["x"]]
        is_inside = (abs(self.ball_to_target()) < room).all(axis=-1)
        return float(is_inside) if self.num_envs is None else is_inside.astype(float)


class BallInCup(base.Task[Physics]):
    """Keep the ball in the cup."""

    GOAL = ("in_cup",)
    planner_cost = "limberjack.planner.single_stage.reaching:BallInCup"

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a position of the ball without contacts, at rest."""
        self.draw_collision_free_start(physics, lambda: self._draw_start(physics))
        super().initialize_episode(physics)

    def _draw_start(self, physics: Physics) -> None:
        physics.named.data.qpos["ball_x"] = self.random.uniform(-0.2, 0.2)
        physics.named.data.qpos["ball_z"] = self.random.uniform(0.2, 0.5)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Positions and velocities."""
        return collections.OrderedDict(position=physics.position(), velocity=physics.velocity())

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """1 while the ball is in the cup, else 0."""
        return {"in_cup": physics.in_target()}
