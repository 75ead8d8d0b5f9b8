"""Swimmer: a chain of links in a viscous fluid brings its nose to a target in the plane.

The tasks come from the DeepMind Control Suite (https://arxiv.org/abs/1801.00690); the swimmer
comes from Coulom (2002), "Reinforcement learning using neural networks".
"""

import collections
from xml.etree import ElementTree

import numpy as np

from limberjack import mujoco
from limberjack.rl import control
from limberjack.suite import _chain, base, common
from limberjack.suite.base import Kwargs, Seed
from limberjack.suite.utils import randomizers
from limberjack.utils import arrays, containers, rewards, xml_tools

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Physics",
    "Swimmer",
    "get_model_and_assets",
    "swimmer",
    "swimmer6",
    "swimmer15",
]

_DEFAULT_TIME_LIMIT = 30  # seconds
_CONTROL_TIMESTEP = 0.03  # seconds

_SHORTEST = 3  # links; as in dm_control
_CAMERA_LINKS = 6  # the length for which the file places the tracking cameras
_CLOSE_PROBABILITY = 0.2  # of a target close to the middle
_CLOSE, _FAR = 0.3, 2  # metres; half the side of the square that holds the target
_ROOT_JOINTS = 3  # x, y and rotation of the head
_POSE_SENSORS = 12  # numbers of the four sensors before the velocities, three each
_PLANAR = [0, 1, 5]  # of a link's linear and angular velocity: x, y, and about z

SUITE = containers.TaggedTasks()
# Chosen by eye: a target in the picture.
PICTURES = dict.fromkeys(("swimmer6", "swimmer15"), base.Picture("tracking1", seed=25, steps=3))
OBSERVATIONS = {
    "joints": base.Observed("angles between the links, from the head on", "rad"),
    "to_target": base.Observed("x and y from the nose to the target, in the head's frame", "m"),
    "body_velocities": base.Observed(
        "velocity of each link in its own frame, from the head on: x; y; about z", "m/s; m/s; rad/s"
    ),
}


def get_model_and_assets(n_joints: int) -> tuple[bytes, dict[str, bytes]]:
    """The MJCF of a swimmer of `n_joints` links, the head included, and the files it includes.

    Raises:
      ValueError: `n_joints` is not a whole number of at least 3 in range.
    """
    return _model("n_joints", n_joints)


def _model(name: str, value: object) -> tuple[bytes, dict[str, bytes]]:
    """The model of a swimmer whose number of links is given by an argument of this name."""
    links = _chain.checked_length(name, value, _SHORTEST)
    root = _chain.with_templates(common.read_model("swimmer.xml"))
    head = xml_tools.find_element(root, "body", "head")
    # With every joint at its limit the chain closes to a circle.
    _chain.repeat(head, range(links - 1), limit=360.0 / links)
    for section in ("actuator", "sensor"):
        (parent,) = root.iterfind(section)
        _chain.repeat(parent, range(links - 1))
    for camera in root.iterfind(".//camera[@mode='trackcom']"):
        position = map(float, camera.attrib["pos"].split())
        camera.set("pos", " ".join(str(x * (links / _CAMERA_LINKS)) for x in position))
    return ElementTree.tostring(root), common.ASSETS


@SUITE.add("benchmarking")
def swimmer6(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swim to the target with six links."""
    return swimmer(6, time_limit, random, environment_kwargs)


@SUITE.add("benchmarking")
def swimmer15(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Swim to the target with fifteen links."""
    return swimmer(15, time_limit, random, environment_kwargs)


def swimmer(
    n_links: int = 3,
    time_limit: float = _DEFAULT_TIME_LIMIT,
    random: Seed = None,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Swim to the target with `n_links` links; not a registered task."""
    physics, task = Physics.from_shared_xml(*_model("n_links", n_links)), Swimmer(random)
    kwargs = environment_kwargs or {}
    return control.Environment(physics, task, time_limit, _CONTROL_TIMESTEP, **kwargs)


class Physics(mujoco.Physics):
    """Measurements of the swimmer."""

    def nose_to_target(self) -> np.ndarray:
        """Position of the target from the nose, in the head's frame, (..., 2), metres."""
        positions = self.named.data.geom_xpos
        to_target = positions["target"] - positions["nose"]
        return arrays.to_frame(to_target, self.named.data.xmat["head"])[..., :2]

    def nose_to_target_dist(self) -> arrays.Quantity:
        """Distance of the nose from the target, (...), metres."""
        return arrays.norm(self.nose_to_target())

    def body_velocities(self) -> np.ndarray:
        """Velocities of the links in their own frames, (..., 3 links): x, y, about z of each."""
        readings = self.data.sensordata[..., _POSE_SENSORS:]
        rows = readings.shape[:-1]
        return readings.reshape(*rows, -1, 6)[..., _PLANAR].reshape(*rows, -1)

    def joints(self) -> np.ndarray:
        """Angles between the links, (..., links - 1), radians."""
        return self.data.qpos[..., _ROOT_JOINTS:].copy()


class Swimmer(base.Task[Physics]):
    """Bring the nose to the target."""

    GOAL = ("near",)
    planner_cost = "limberjack.planner.single_stage.travelling:Swimmer"
    STARTS = ("close", "far")
    EPISODE_FIELDS = ("geom_pos", "light_pos")  # the target, and the light above it

    def initialize_episode(self, physics: Physics) -> None:
        """Random direction and joint angles at rest, and a random target."""
        randomizers.randomize_limited_and_rotational_joints(physics, self.random)
        half_side = _CLOSE if self.random.rand() < _CLOSE_PROBABILITY else _FAR
        place = self.random.uniform(-half_side, half_side, size=2)
        physics.named.model.geom_pos["target", ["x", "y"]] = place
        physics.named.model.light_pos["target_light", ["x", "y"]] = place
        super().initialize_episode(physics)

    def start(self, physics: Physics) -> str:
        """Whether the target is close to the middle, where the swimmer starts, or far from it."""
        place = physics.named.model.geom_pos["target", ["x", "y"]]
        return "close" if abs(place).max() <= _CLOSE else "far"

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Shape of the chain, direction of the target, and velocities."""
        obs = collections.OrderedDict()
        obs["joints"] = physics.joints()
        obs["to_target"] = physics.nose_to_target()
        obs["body_velocities"] = physics.body_velocities()
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Nearness: 1 with the nose in the target, 0.1 at five radii from its surface."""
        radius = physics.named.model.geom_size["target", "x"]
        distance = physics.nose_to_target_dist()
        near = rewards.tolerance(distance, (0, radius), margin=5 * radius, sigmoid="long_tail")
        return {"near": near}
