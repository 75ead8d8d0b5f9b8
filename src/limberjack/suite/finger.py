"""Finger: two links with torques turn a body on a hinge without motor.

`spin` rewards every step in which the body turns fast; `turn_easy` and `turn_hard` every step in
which its tip is in a target. The tasks come from https://arxiv.org/abs/1801.00690.
"""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import base, common
from limberjack.suite.base import Kwargs, Seed
from limberjack.suite.utils import randomizers
from limberjack.utils import arrays, containers, rewards

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Physics",
    "Spin",
    "Turn",
    "get_model_and_assets",
    "spin",
    "turn_easy",
    "turn_hard",
]

_DEFAULT_TIME_LIMIT = 20  # seconds
_CONTROL_TIMESTEP = 0.02  # seconds

_LINKS = ["proximal", "distal"]
_VELOCITIES = ["proximal_velocity", "distal_velocity", "hinge_velocity"]
_EASY_TARGET_SIZE = 0.07  # metres; radius of the target
_HARD_TARGET_SIZE = 0.03  # metres; the same for the harder task
_SPIN_VELOCITY = 15.0  # radians per second, backwards; from there on the body counts as spinning
_SPIN_DAMPING = 0.03  # N m s / rad; less than the model's, so that the body keeps spinning

SUITE = containers.TaggedTasks()
# Chosen by eye: starts in which finger, body and target are apart.
_SEEDS = {"spin": 3, "turn_easy": 5, "turn_hard": 1}
PICTURES = {task: base.Picture("cam0", seed) for task, seed in _SEEDS.items()}
OBSERVATIONS = {
    "position": base.Observed("angles of the two links; x, z of the tip from the hinge", "rad; m"),
    "velocity": base.Observed("angular velocities of the two links and the body", "rad/s"),
    "touch": base.Observed("log(1 + force) on the top and the bottom of the fingertip", "log N"),
    "target_position": base.Observed("x, z of the target's centre from the hinge", "m"),
    "dist_to_target": base.Observed("distance of the tip from the target, negative inside", "m"),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("finger.xml"), common.ASSETS


@SUITE.add("benchmarking")
def spin(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Keep the body spinning at 15 rad/s or more."""
    return _environment(Spin(random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def turn_easy(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Turn the body's tip into a target with a radius of 7 cm."""
    return _environment(Turn(_EASY_TARGET_SIZE, random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def turn_hard(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Turn the body's tip into a target with a radius of 3 cm."""
    return _environment(Turn(_HARD_TARGET_SIZE, random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of finger, body and target, all from sensors."""

    def touch(self) -> np.ndarray:
        """Logarithm of one plus the forces on the fingertip's top and bottom, (..., 2)."""
        return np.log1p(self.named.data.sensordata[["touchtop", "touchbottom"]])

    def hinge_velocity(self) -> arrays.Quantity:
        """Angular velocity of the body, (...), radians per second."""
        return self.named.data.sensordata["hinge_velocity"].T[0]

    def tip_position(self) -> np.ndarray:
        """x and z of the body's tip relative to the hinge, (..., 2), metres."""
        position = self.named.data.sensordata
        return position["tip"][..., ::2] - position["spinner"][..., ::2]

    def bounded_position(self) -> np.ndarray:
        """Angles of the two links, and `tip_position` in place of the body's angle, (..., 4)."""
        return arrays.concat((self.named.data.sensordata[_LINKS], self.tip_position()))

    def velocity(self) -> np.ndarray:
        """Angular velocities of the two links and the body, (..., 3), radians per second."""
        return self.named.data.sensordata[_VELOCITIES]

    def target_position(self) -> np.ndarray:
        """x and z of the target relative to the hinge, (..., 2), metres."""
        position = self.named.data.sensordata
        return position["target"][..., ::2] - position["spinner"][..., ::2]

    def to_target(self) -> np.ndarray:
        """Vector from the tip to the target, x and z, (..., 2), metres."""
        return self.target_position() - self.tip_position()

    def dist_to_target(self) -> arrays.Quantity:
        """Distance of the tip from the target's surface, (...), metres; negative inside."""
        return arrays.norm(self.to_target()) - self.named.model.site_size["target", 0]


class _Task(base.Task[Physics]):
    """The start and the observations that all tasks share."""

    def initialize_episode(self, physics: Physics) -> None:
        """Draws random angles without contacts, at rest."""
        draw = randomizers.randomize_limited_and_rotational_joints
        self.draw_collision_free_start(physics, lambda: draw(physics, self.random))
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Positions, velocities and touch sensors."""
        position, velocity = physics.bounded_position(), physics.velocity()
        return collections.OrderedDict(position=position, velocity=velocity, touch=physics.touch())


class Spin(_Task):
    """Spin the body; its hinge has little damping, and tip and target are invisible."""

    GOAL = ("spinning",)
    planner_cost = "limberjack.planner.single_stage.turning:Spin"
    EPISODE_FIELDS = ("dof_damping", "site_rgba")

    def initialize_episode(self, physics: Physics) -> None:
        """Draws random angles without contacts, at rest."""
        physics.named.model.site_rgba[["target", "tip"], 3] = 0
        physics.named.model.dof_damping["hinge"] = _SPIN_DAMPING
        super().initialize_episode(physics)

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Whether the body spins fast enough, 0 or 1."""
        return {"spinning": rewards.tolerance(physics.hinge_velocity(), (-np.inf, -_SPIN_VELOCITY))}


class Turn(_Task):
    """Turn the body until its tip is in the target."""

    GOAL = ("in_target",)
    planner_cost = "limberjack.planner.single_stage.reaching:Turn"
    EPISODE_FIELDS = ("site_pos", "site_size")

    def __init__(self, target_radius: float, random: Seed = None) -> None:
        """Rewards a tip within `target_radius` of a random point of its circle, metres."""
        self._target_radius = target_radius
        super().__init__(random=random)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws the target on the circle of the tip, then angles without contacts, at rest."""
        angle = self.random.uniform(-np.pi, np.pi)
        model = physics.named.model
        x, z = physics.named.data.xanchor["hinge", ["x", "z"]]
        radius = model.geom_size["cap1"].sum()
        place = x + radius * np.sin(angle), z + radius * np.cos(angle)
        model.site_pos["target", ["x", "z"]] = place
        model.site_size["target", 0] = self._target_radius
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Positions, velocities, touch sensors and the target."""
        obs = super().get_observation(physics)
        obs["target_position"] = physics.target_position()
        obs["dist_to_target"] = physics.dist_to_target()
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Whether the tip is in the target, 0 or 1."""
        return {"in_target": rewards.tolerance(physics.dist_to_target(), (-np.inf, 0))}
