"""Humanoid: stand up, walk or run, with 21 torques.

An episode begins in a random pose above the ground. The reward is the product of terms for a high
head, an upright torso, low effort and horizontal speed. The model comes from Tassa, Erez & Todorov
(2012); the tasks come from the DeepMind Control Suite (https://arxiv.org/abs/1801.00690).
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
    "Humanoid",
    "Physics",
    "get_model_and_assets",
    "run",
    "run_pure_state",
    "stand",
    "walk",
]

_DEFAULT_TIME_LIMIT = 25  # seconds
_CONTROL_TIMESTEP = 0.025  # seconds

_STAND_HEIGHT = 1.4  # metres; head height at which standing is fully rewarded
_UPRIGHT = 0.9  # cosine of the tilt below which the torso counts as upright, 26 degrees
_WALK_SPEED = 1  # metres per second; horizontal speed at which walking is fully rewarded
_RUN_SPEED = 10  # metres per second; the same for running

_ROOT_POSITIONS = 7  # elements of qpos for the free root: a position and a quaternion
_FALL_TIME = 1.0  # seconds; without control, every humanoid is on the ground after this time
_UP_HEIGHT = 0.7  # metres; half the head height at which standing is fully rewarded
_FACING = 0.5  # cosine of 60 degrees

SUITE = containers.TaggedTasks()
# Chosen by eye: starts in which the whole body is visible.
PICTURES = {
    "stand": base.Picture("side", seed=242, steps=4),
    "walk": base.Picture("side", seed=159, steps=4),
    "run": base.Picture("side", seed=237, steps=4),
    "run_pure_state": base.Picture("back", seed=141, steps=4),
}
OBSERVATIONS = {
    "joint_angles": base.Observed("angles of the hinges, in the order of the joints", "rad"),
    "head_height": base.Observed("height of the centre of the head", "m"),
    "extremities": base.Observed(
        "x, y, z in the torso's frame: left hand, left foot, right hand, right foot", "m"
    ),
    "torso_vertical": base.Observed(
        "the world's vertical in the torso's frame; its last number is 1 upright, -1 head down"
    ),
    "com_velocity": base.Observed("velocity of the body's centre of mass in the world", "m/s"),
    "position": base.Observed(
        "root x, y, z; root quaternion w, x, y, z; angles of the hinges", "m; 1; rad"
    ),
    "velocity": base.Observed(
        "root's linear velocity in the world; root's angular velocity in its own frame; hinges",
        "m/s; rad/s; rad/s",
    ),
}


def get_model_and_assets() -> tuple[bytes, dict[str, bytes]]:
    """The model's MJCF and the files that it includes."""
    return common.read_model("humanoid.xml"), common.ASSETS


@SUITE.add("benchmarking")
def stand(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Stand up and stand still."""
    return _environment(0, False, time_limit, random, environment_kwargs)


@SUITE.add("benchmarking")
def walk(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Walk in any direction at 1 m/s or more."""
    return _environment(_WALK_SPEED, False, time_limit, random, environment_kwargs)


@SUITE.add("benchmarking")
def run(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Run in any direction, up to 10 m/s."""
    return _environment(_RUN_SPEED, False, time_limit, random, environment_kwargs)


@SUITE.add()
def run_pure_state(
    time_limit: float = _DEFAULT_TIME_LIMIT, random: Seed = None, environment_kwargs: Kwargs = None
) -> control.Environment:
    """Run, observing only generalised positions and velocities."""
    return _environment(_RUN_SPEED, True, time_limit, random, environment_kwargs)


def _environment(
    move_speed: float, pure_state: bool, time_limit: float, random: Seed, kwargs: Kwargs
) -> control.Environment:
    physics = Physics.from_shared_xml(*get_model_and_assets())
    task = Humanoid(move_speed=move_speed, pure_state=pure_state, random=random)
    return control.Environment(
        physics, task, time_limit=time_limit, control_timestep=_CONTROL_TIMESTEP, **kwargs or {}
    )


class Physics(mujoco.Physics):
    """Measurements of the humanoid; `humanoid_CMU` names the parts of its own body."""

    _TORSO = "torso"
    _UP, _FRONT = "zz", "zx"  # vertical components of the torso's axes: to the head, and ahead
    _LIMBS: ClassVar = ["left_hand", "left_foot", "right_hand", "right_foot"]

    def torso_upright(self) -> arrays.Quantity:
        """Cosine of the torso's tilt, (...): 1 upright, -1 head down."""
        return self.named.data.xmat[self._TORSO, self._UP]

    def facing_up(self) -> arrays.Quantity:
        """Vertical component of the torso's forward axis, (...): 1 on its back, -1 on its front."""
        return self.named.data.xmat[self._TORSO, self._FRONT]

    def head_height(self) -> arrays.Quantity:
        """Height of the head, (...), metres."""
        return self.named.data.xpos["head", "z"]

    def center_of_mass_position(self) -> np.ndarray:
        """Centre of mass of the torso and everything attached to it, (..., 3), metres."""
        return self.named.data.subtree_com[self._TORSO].copy()

    def center_of_mass_velocity(self) -> np.ndarray:
        """Velocity of `center_of_mass_position`, (..., 3), metres per second."""
        return self.named.data.sensordata[f"{self._TORSO}_subtreelinvel"].copy()

    def torso_vertical_orientation(self) -> np.ndarray:
        """The world's vertical axis in the torso frame, (..., 3)."""
        return self.named.data.xmat[self._TORSO, ["zx", "zy", "zz"]]

    def joint_angles(self) -> np.ndarray:
        """Angles of the hinges, (..., k), radians: all positions except the root's."""
        return self.data.qpos[..., _ROOT_POSITIONS:].copy()

    def extremities(self) -> np.ndarray:
        """Hands and feet in the torso frame, (..., 12), metres: left hand and foot, then right."""
        xpos, xmat = self.named.data.xpos, self.named.data.xmat
        from_torso = xpos[self._LIMBS] - xpos[self._TORSO][..., None, :]
        limbs = arrays.to_frame(from_torso, xmat[self._TORSO])
        return limbs.reshape(*limbs.shape[:-2], -1)


def _set_contact_friction(root: Element, friction: float) -> None:
    geoms = (
        _parameters.default_of(root, "body", "geom"),
        xml_tools.find_element(root, "geom", "floor"),
    )
    for geom in geoms:
        _parameters.set_numbers(geom, "friction", friction, 0.1, 0.1)


def _set_joint_damping(root: Element, damping: float) -> None:
    _parameters.set_numbers(_parameters.default_of(root, "body", "joint"), "damping", damping)


def _set_head_size(root: Element, radius: float) -> None:
    _parameters.set_numbers(xml_tools.find_element(root, "geom", "head"), "size", radius)


class Humanoid(base.Task[Physics]):
    """Stand, or move at least at a given speed."""

    PERTURBATIONS: ClassVar[Mapping[str, Parameter]] = {
        "contact_friction": Parameter(
            _set_contact_friction,
            0.7,
            Range(0.05, 1.2, 0.1),
            _parameters.challenges(
                Range(0.6, 0.8, 0.02), Range(0.5, 0.9, 0.04), Range(0.4, 1.0, 0.06)
            ),
        ),
        "joint_damping": Parameter(_set_joint_damping, 0.2, Range(0.01, 2.5, 0.2)),
        "head_size": Parameter(_set_head_size, 0.09, Range(0.01, 0.19, 0.02)),
    }
    GOAL = ("standing", "upright", "movement")
    STARTS = ("face_up", "face_down", "on_side", "up")
    planner_cost: str | None = "limberjack.planner.humanoid.locomotion:Locomotion"

    def __init__(self, move_speed: float, pure_state: bool, random: Seed = None) -> None:
        """Creates the task.

        Args:
          move_speed: horizontal speed that is fully rewarded, m/s; 0 rewards standing still.
          pure_state: observe generalised positions and velocities instead of features.
          random: a `numpy.random.RandomState`, a seed, or None.
        """
        self._move_speed = move_speed
        self._pure_state = pure_state
        super().__init__(random=random)

    @property
    def move_speed(self) -> float:
        """Horizontal speed that is fully rewarded, m/s; 0 rewards standing still."""
        return self._move_speed

    def initialize_episode(self, physics: Physics) -> None:
        """Draws a random pose without contacts, at rest."""
        draw = randomizers.randomize_limited_and_rotational_joints
        self.draw_collision_free_start(physics, lambda: draw(physics, self.random))
        super().initialize_episode(physics)

    def start(self, physics: Physics) -> str:
        """The pose in which a copy lands within a second; 'on_side' beyond 60 degrees."""
        fall = physics.copy(share_model=True)
        fall.set_control(np.zeros(fall.model.nu))
        fall.step(round(_FALL_TIME / fall.timestep()))
        if fall.head_height() >= _UP_HEIGHT:
            return "up"
        front = fall.facing_up()
        if abs(front) < _FACING:
            return "on_side"
        return "face_up" if front > 0 else "face_down"

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """Features relative to the torso, or the pure state."""
        obs = collections.OrderedDict()
        if self._pure_state:
            obs["position"] = physics.position()
            obs["velocity"] = physics.velocity()
            return obs
        obs["joint_angles"] = physics.joint_angles()
        obs["head_height"] = physics.head_height()
        obs["extremities"] = physics.extremities()
        obs["torso_vertical"] = physics.torso_vertical_orientation()
        obs["com_velocity"] = physics.center_of_mass_velocity()
        obs["velocity"] = physics.velocity()
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, arrays.Quantity]:
        """Factors of the reward: head height, uprightness, effort and horizontal speed."""
        standing = rewards.tolerance(
            physics.head_height(), (_STAND_HEIGHT, np.inf), margin=_STAND_HEIGHT / 4
        )
        return {
            "standing": standing,
            "upright": locomotion.upright(physics.torso_upright(), at_least=_UPRIGHT),
            "small_control": locomotion.low_effort(physics.control()),
            "movement": self._movement(physics.center_of_mass_velocity()[..., :2]),
        }

    def _movement(self, horizontal_velocity: np.ndarray) -> arrays.Quantity:
        """Reward factor for the horizontal velocity, (..., 2) -> (...)."""
        if self._move_speed == 0:
            return rewards.mean_tolerance(horizontal_velocity, margin=2)
        move = locomotion.speed(arrays.norm(horizontal_velocity), at_least=self._move_speed)
        return (5 * move + 1) / 6  # standing still keeps a sixth

    def reward_of(self, terms: dict[str, arrays.Quantity]) -> arrays.Quantity:
        """The product of all terms, between 0 and 1."""
        return terms["small_control"] * (terms["standing"] * terms["upright"]) * terms["movement"]
