"""Walker: a planar body on two legs stands, walks or runs, with six torques.

An episode begins in a random pose. A high and upright torso is rewarded, scaled by horizontal
speed. The tasks come from https://arxiv.org/abs/1801.00690.
"""

import collections
from collections.abc import Mapping
from typing import ClassVar
from xml.etree.ElementTree import Element

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import _locomotion as locomotion
from limberjack.suite import _parameters, base, common
from limberjack.suite.base import Kwargs, Seed
from limberjack.suite.utils import randomizers
from limberjack.utils import arrays, containers, rewards, xml_tools
from limberjack.worlds.faults import Parameter, Range

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

# Of the model, metres.
_THIGH_RADIUS, _TORSO_RADIUS, _HALF_LEG = 0.05, 0.07, 0.25

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


def _set_thigh_length(root: Element, length: float) -> None:
    """Sets half the length of the thighs, metres; the legs hang from their ends."""
    for side in ("right", "left"):
        thigh = xml_tools.find_element(root, "geom", f"{side}_thigh")
        _parameters.set_numbers(thigh, "pos", 0, 0, -length)
        _parameters.set_numbers(thigh, "size", _THIGH_RADIUS, length)
        leg = xml_tools.find_element(root, "body", f"{side}_leg")
        _parameters.set_numbers(leg, "pos", 0, 0, -_HALF_LEG - 2 * length)


def _set_torso_length(root: Element, length: float) -> None:
    """Sets half the length of the torso, metres; the thighs hang from its end."""
    torso = xml_tools.find_element(root, "geom", "torso")
    _parameters.set_numbers(torso, "size", _TORSO_RADIUS, length)
    for side in ("right", "left"):
        thigh = xml_tools.find_element(root, "body", f"{side}_thigh")
        # As the Real World RL suite: both thighs are on one side of the plane.
        _parameters.set_numbers(thigh, "pos", 0, -0.05, -length)


def _set_joint_damping(root: Element, damping: float) -> None:
    _parameters.set_numbers(_parameters.default_of(root, None, "joint"), "damping", damping)


def _set_contact_friction(root: Element, friction: float) -> None:
    # That of the floor too, which has the defaults of all geoms.
    geom = _parameters.default_of(root, None, "geom")
    _parameters.set_numbers(geom, "friction", friction, 0.1, 0.1)


class PlanarWalker(base.Task[Physics]):
    """Stand, or move forward at least at a given speed."""

    PERTURBATIONS: ClassVar[Mapping[str, Parameter]] = {
        "thigh_length": Parameter(
            _set_thigh_length,
            0.225,
            Range(0.1, 0.7, 0.05),
            _parameters.challenges(
                Range(0.225, 0.25, 0.002), Range(0.225, 0.4, 0.015), Range(0.225, 0.55, 0.04)
            ),
        ),
        "torso_length": Parameter(_set_torso_length, 0.3, Range(0.1, 0.7, 0.05)),
        "joint_damping": Parameter(_set_joint_damping, 0.1, Range(0.1, 10.0, 0.5)),
        "contact_friction": Parameter(_set_contact_friction, 0.7, Range(0.01, 2.0, 0.05)),
    }
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
