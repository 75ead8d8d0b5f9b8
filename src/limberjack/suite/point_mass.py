"""Point mass: push a ball to the middle of a table; from https://arxiv.org/abs/1801.00690."""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import _locomotion as locomotion
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
    "PointMass",
    "easy",
    "get_model_and_assets",
    "hard",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_PARALLEL = 0.9  # cosine of the angle between two directions above which both are too similar

SUITE = containers.TaggedTasks()
PICTURES = {"easy": base.Picture("fixed", seed=1), "hard": base.Picture("cam0", seed=1)}
OBSERVATIONS = {
    "position": base.Observed("x and y of the ball", "m"),
    "velocity": base.Observed("velocity of the ball along x and y", "m/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("point_mass.xml"), common.ASSETS


@SUITE.add("benchmarking", "easy")
def easy(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Push with one control along x and one along y."""
    return _environment(PointMass(False, random), time_limit, environment_kwargs)


@SUITE.add()
def hard(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Push with controls along two random directions, which are not observed."""
    return _environment(PointMass(True, random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit=time_limit, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the ball."""

    def mass_to_target(self) -> np.ndarray:
        """Vector from the ball to the target, (..., 3), metres."""
        positions = self.named.data.geom_xpos
        return positions["target"] - positions["pointmass"]

    def mass_to_target_dist(self) -> arrays.Quantity:
        """Distance from the ball to the target, (...), metres."""
        return arrays.norm(self.mass_to_target())


class PointMass(base.Task[Physics]):
    """Hold the ball at the target, with little effort."""

    GOAL = ("near_target",)
    planner_cost = "limberjack.planner.single_stage.travelling:PointMass"

    def __init__(self, randomize_gains: bool, random: Seed = None) -> None:
        """Creates the task; `randomize_gains` draws the controls' directions for each episode."""
        self._randomize_gains = randomize_gains
        self.EPISODE_FIELDS = ("wrap_prm",) if randomize_gains else ()
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a position at rest and, if the gains are random, the controls' directions."""
        randomizers.randomize_limited_and_rotational_joints(physics, self.random)
        if self._randomize_gains:
            first, second = self._direction(), self._direction()
            while abs(first.dot(second)) > _PARALLEL:
                second = self._direction()
            # The tendons' coefficients: x and y of the first, x and y of the second.
            physics.model.wrap_prm[:4] = [*first, *second]
        super().initialize_episode(physics)

    def _direction(self) -> np.ndarray:
        direction = self.random.randn(2)
        return direction / np.linalg.norm(direction)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Position and velocity."""
        return collections.OrderedDict(position=physics.position(), velocity=physics.velocity())

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Closeness to the target, and effort."""
        radius = physics.named.model.geom_size["target", "x"]
        near = rewards.tolerance(physics.mass_to_target_dist(), (0, radius), margin=radius)
        return {"near_target": near, "small_control": locomotion.low_effort(physics.control())}
