"""Walker: a planar body on two legs stands, walks or runs, with six torques.

An episode begins in a random pose. A high and upright torso is rewarded, scaled by horizontal
speed. The tasks come from https://arxiv.org/abs/1801.00690.
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
    "Physics",
    "PlanarWalker",
    "get_model_and_assets",
    "run",
    "stand",
    "walk",
]

_DEFAULT_TIME_LIMIT = 25  # seconds
_CONTROL_TIMESTEP = 0.025  # seconds

_STAND_HEIGHT = 1.2  # metres; torso height at which standing is fully rewarded
_WALK_SPEED = 1  # metres per second; horizontal speed at which walking is fully rewarded
_RUN_SPEED = 8  # metres per second; the same for running

SUITE = containers.TaggedTasks()
# Chosen by eye: starts that look like the task.
PICTURES = {
    task: base.Picture("side", seed) for task, seed in (("stand", 0), ("walk", 2), ("run", 3))
}
OBSERVATIONS = {
    "orientations": base.Observed(
        "cosine and sine of each body's angle from upright: torso, right thigh, leg, foot, left"
    ),
    "height": base.Observed("height of the torso's centre", "m"),
    "velocity": base.Observed("root z and x; rotation of the root; hinges", "m/s; rad/s; rad/s"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("walker.xml"), common.ASSETS


@SUITE.add("benchmarking")
def stand(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Stand up and stay upright; moving is not penalised."""
    return _environment(PlanarWalker(0, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def walk(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Walk forward at 1 m/s or more."""
    return _environment(PlanarWalker(_WALK_SPEED, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def run(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Run forward at 8 m/s or more."""
    return _environment(PlanarWalker(_RUN_SPEED, random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of the walker."""

    def torso_upright(self) -> arrays.Quantity:
        """Cosine of the torso's tilt, (...): 1 upright, -1 upside down."""
        return self.named.data.xmat["torso", "zz"]

    def torso_height(self) -> arrays.Quantity:
        """Height of the torso's centre, (...), metres."""
        return self.named.data.xpos["torso", "z"]

    def horizontal_velocity(self) -> arrays.Quantity:
        """Velocity of the whole body's centre of mass along x, (...), metres per second."""
        return locomotion.forward_speed(self)

    def orientations(self) -> np.ndarray:
        """Cosine and sine of each body's angle from upright, (..., 14): torso, right, left leg."""
        pairs = self.named.data.xmat[1:, ["xx", "xz"]]
        return pairs.reshape(*pairs.shape[:-2], -1)


class PlanarWalker(base.Task[Physics]):
    """Stand, or move forward at least at a given speed."""

    planner_cost = "limberjack.planner.single_stage.locomotion:Walker"

    def __init__(self, move_speed: float, random: Seed = None) -> None:
        """Rewards a forward speed of `move_speed`, m/s; 0 rewards standing alone."""
        self._move_speed = move_speed
        self.GOAL = ("standing", "upright", "movement") if move_speed else ("standing", "upright")
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a random pose at rest, which may touch or pass through the floor."""
        randomizers.randomize_limited_and_rotational_joints(physics, self.random)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Orientations of the bodies, height and velocities."""
        obs = collections.OrderedDict()
        obs["orientations"] = physics.orientations()
        obs["height"] = physics.torso_height()
        obs["velocity"] = physics.velocity()
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Height and uprightness of the torso, and forward speed if the task is to move."""
        height, speed = physics.torso_height(), self._move_speed
        terms = {
            "standing": rewards.tolerance(height, (_STAND_HEIGHT, np.inf), _STAND_HEIGHT / 2),
            "upright": (1 + physics.torso_upright()) / 2,
        }
        if speed != 0:
            velocity = physics.horizontal_velocity()
            terms["movement"] = locomotion.speed(velocity, speed, speed / 2, value_at_margin=0.5)
        return terms

    def reward_of(self, terms: dict[str, arrays.Quantity]) -> arrays.Quantity:
        """Mean of standing, thrice, and upright; a sixth of it is kept without movement."""
        stand_reward = (3 * terms["standing"] + terms["upright"]) / 4
        if self._move_speed == 0:
            return stand_reward
        return stand_reward * (5 * terms["movement"] + 1) / 6
