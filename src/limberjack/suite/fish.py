"""Fish: turn upright or swim to a target in a fluid, with five position actuators.

An episode begins in a random orientation. The tasks come from
https://arxiv.org/abs/1801.00690.
"""

import collections

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import base, common
from limberjack.suite.base import Kwargs, Seed
from limberjack.utils import arrays, containers, rewards

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Physics",
    "Swim",
    "Upright",
    "get_model_and_assets",
    "swim",
    "upright",
]

_DEFAULT_TIME_LIMIT = 40  # seconds
_CONTROL_TIMESTEP = 0.04  # seconds
_JOINTS = ["tail1", "tail_twist", "tail2"]
_JOINTS += [f"fin{side}_{axis}" for side in ("right", "left") for axis in ("roll", "pitch")]

_BENT = 0.2  # radians; largest angle of a joint at the start
_TARGET_BOUNDS = [-0.4, -0.4, 0.1], [0.4, 0.4, 0.3]  # metres; x, y, z, all above the ground

SUITE = containers.TaggedTasks()
# Chosen by eye: starts in which the fish is seen from the side, and the target if there is one.
PICTURES = {"upright": base.Picture("tracking_x", 14), "swim": base.Picture("tracking_y", 10)}
OBSERVATIONS = {
    "joint_angles": base.Observed("angles of tail, right and left fin", "rad"),
    "upright": base.Observed("cosine of the torso's tilt: 1 upright, -1 upside down"),
    "target": base.Observed("x, y, z of the target in the mouth's frame", "m"),
    "velocity": base.Observed(
        "root's linear velocity in the world; root's angular velocity in its own frame; joints",
        "m/s; rad/s; rad/s",
    ),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("fish.xml"), common.ASSETS


@SUITE.add("benchmarking")
def upright(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Turn upright and stay upright."""
    return _environment(Upright(random), time_limit, environment_kwargs)


@SUITE.add("benchmarking")
def swim(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swim until the mouth is in the target."""
    return _environment(Swim(random), time_limit, environment_kwargs)


def _environment(task: base.Task, time_limit: float, kwargs: Kwargs) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs or {})


class Physics(mujoco.Physics):
    """Measurements of fish and target."""

    def upright(self) -> arrays.Quantity:
        """Cosine of the torso's tilt, (...): 1 upright, -1 upside down."""
        return self.named.data.xmat["torso", "zz"]

    def torso_velocity(self) -> np.ndarray:
        """Linear, then angular velocity of the torso in its own frame, (..., 6), m/s and rad/s."""
        return self.data.sensordata.copy()

    def joint_velocities(self) -> np.ndarray:
        """Velocities of tail, right and left fin, (..., 7), radians per second."""
        return self.named.data.qvel[_JOINTS]

    def joint_angles(self) -> np.ndarray:
        """Angles of tail, right and left fin, (..., 7), radians."""
        return self.named.data.qpos[_JOINTS]

    def mouth_to_target(self) -> np.ndarray:
        """Vector from mouth to target in the mouth's frame, (..., 3), metres."""
        data = self.named.data
        to_target = data.geom_xpos["target"] - data.geom_xpos["mouth"]
        return arrays.to_frame(to_target, data.geom_xmat["mouth"])


class _Task(base.Task[Physics]):
    """The pose at the start and the observations that both tasks share."""

    def draw_pose(self, physics: Physics) -> None:
        """Draws a random orientation and slightly bent joints."""
        quaternion = self.random.randn(4)
        physics.data.qpos[3:7] = quaternion / np.linalg.norm(quaternion)
        physics.named.data.qpos[_JOINTS] = self.random.uniform(-_BENT, _BENT, len(_JOINTS))

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Angles of the joints, uprightness and velocities."""
        obs = collections.OrderedDict()
        obs["joint_angles"] = physics.joint_angles()
        obs["upright"] = physics.upright()
        obs["velocity"] = physics.velocity()
        return obs


class Upright(_Task):
    """Turn the torso upright; the target is invisible."""

    GOAL = ("upright",)
    planner_cost = "limberjack.planner.single_stage.turning:FishUpright"
    EPISODE_FIELDS = ("geom_rgba",)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a random pose, at rest, and hides the target."""
        self.draw_pose(physics)
        physics.named.model.geom_rgba["target", 3] = 0
        super().initialize_episode(physics)

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Uprightness."""
        return {"upright": rewards.tolerance(physics.upright(), (1, 1), margin=1)}


class Swim(_Task):
    """Swim to the target, preferably upright."""

    GOAL = ("in_target",)
    planner_cost = "limberjack.planner.single_stage.reaching:Fish"
    EPISODE_FIELDS = ("geom_pos",)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a random pose, at rest, and the target's position."""
        self.draw_pose(physics)
        low, high = _TARGET_BOUNDS
        physics.named.model.geom_pos["target"] = self.random.uniform(low, high)
        super().initialize_episode(physics)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Angles of the joints, uprightness, the target and velocities."""
        obs = super().get_observation(physics)
        obs["target"] = physics.mouth_to_target()
        obs.move_to_end("velocity")
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Closeness of the mouth to the target, and uprightness."""
        radii = physics.named.model.geom_size[["mouth", "target"], 0].sum(axis=-1)
        distance = arrays.norm(physics.mouth_to_target())
        in_target = rewards.tolerance(distance, (0, radii), margin=2 * radii)
        return {"in_target": in_target, "upright": (physics.upright() + 1) / 2}

    def reward_of(self, terms: dict[str, arrays.Quantity]) -> arrays.Quantity:
        """Mean of the two, with weight seven for the target."""
        return (7 * terms["in_target"] + terms["upright"]) / 8
