"""Manipulator: a planar arm brings a ball or a peg to a target, or inserts it into a cup or slot.

The object starts in the hand, at the target, or falling at a random position. The tasks come from
of the DeepMind Control Suite (https://arxiv.org/abs/1801.00690).
"""

import collections
from collections.abc import Mapping
from typing import ClassVar
from xml.etree.ElementTree import Element

import numpy as np

from limberjack.rl import control
from limberjack.suite import _parameters, _planar_arm, base
from limberjack.suite._planar_arm import CONTROL_TIMESTEP as _CONTROL_TIMESTEP
from limberjack.suite._planar_arm import TIME_LIMIT as _TIME_LIMIT
from limberjack.suite._planar_arm import Physics, is_close
from limberjack.suite.base import Kwargs, Seed
from limberjack.utils import containers, xml_tools
from limberjack.utils.arrays import Quantity
from limberjack.worlds.faults import Parameter, Range

__all__ = [
    "OBSERVATIONS",
    "PICTURES",
    "SUITE",
    "Bring",
    "Physics",
    "bring_ball",
    "bring_peg",
    "insert_ball",
    "insert_peg",
    "make_model",
]

# dm_control's names, which task files import.
_ARM_JOINTS, _TOUCH_SENSORS = _planar_arm._ARM_JOINTS, _planar_arm._TOUCH_SENSORS
_CLOSE = _planar_arm._CLOSE

_STARTS = ("in_hand", "in_target", "uniform")
_P_IN_HAND, _P_IN_TARGET = 0.1, 0.1  # probabilities of two of them
_ALL_PROPS = frozenset(("ball", "target_ball", "cup", "peg", "target_peg", "slot"))

SUITE = containers.TaggedTasks()
# Chosen by eye: starts in which the prop and its target are visible.
PICTURES = {
    "bring_ball": base.Picture("fixed", seed=1, steps=3),
    "bring_peg": base.Picture("fixed", seed=5, steps=3),
    "insert_ball": base.Picture("fixed", seed=5, steps=3),
    "insert_peg": base.Picture("fixed", seed=7, steps=3),
}
OBSERVATIONS = {
    **_planar_arm.OBSERVATIONS,
    "object_pos": base.Observed("planar pose of the ball or peg", "m; 1"),
    "object_vel": base.Observed("velocities of the ball or peg: x; z; about y", "m/s; m/s; rad/s"),
    "target_pos": base.Observed("planar pose of the target", "m; 1"),
}
# The planner's cost to bring, and to insert.
_PLANNER_COSTS = {
    False: "limberjack.planner.manipulator.bring:Bring",
    True: "limberjack.planner.manipulator.insert:Insert",
}


def make_model(use_peg: bool, insert: bool) -> tuple[bytes, dict[str, bytes]]:
    """The MJCF with the task's prop, target and receptacle, and the files that it includes.

    Args:
      use_peg: whether the prop is the peg; otherwise the ball.
      insert: whether there is a receptacle: a slot for the peg, a cup for the ball.
    """
    used = ["peg", "target_peg", "slot"] if use_peg else ["ball", "target_ball", "cup"]
    used = used if insert else used[:2]
    return _planar_arm.model_without("manipulator.xml", _ALL_PROPS.difference(used))


@SUITE.add("benchmarking", "hard")
def bring_ball(
    fully_observable: bool = True,
    time_limit: float = _TIME_LIMIT,
    random: Seed = None,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Bring the ball to a target in the air."""
    return _environment(False, False, fully_observable, time_limit, random, environment_kwargs)


@SUITE.add("hard")
def bring_peg(
    fully_observable: bool = True,
    time_limit: float = _TIME_LIMIT,
    random: Seed = None,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Bring the peg to a target pose in the air."""
    return _environment(True, False, fully_observable, time_limit, random, environment_kwargs)


@SUITE.add("hard")
def insert_ball(
    fully_observable: bool = True,
    time_limit: float = _TIME_LIMIT,
    random: Seed = None,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Put the ball into the cup."""
    return _environment(False, True, fully_observable, time_limit, random, environment_kwargs)


@SUITE.add("hard")
def insert_peg(
    fully_observable: bool = True,
    time_limit: float = _TIME_LIMIT,
    random: Seed = None,
    environment_kwargs: Kwargs = None,
) -> control.Environment:
    """Put the peg into the slot."""
    return _environment(True, True, fully_observable, time_limit, random, environment_kwargs)


def _environment(
    use_peg: bool,
    insert: bool,
    fully_observable: bool,
    time_limit: float,
    random: Seed,
    kwargs: Kwargs,
) -> control.Environment:
    return control.Environment(
        Physics.from_shared_xml(*make_model(use_peg, insert)),
        Bring(use_peg, insert, fully_observable, random),
        time_limit=time_limit,
        control_timestep=_CONTROL_TIMESTEP,
        **kwargs or {},
    )


def _set_lower_arm_length(root: Element, length: float) -> None:
    """Sets the length of the lower arm, metres; the hand is at its end."""
    arm = xml_tools.find_element(root, "geom", "lower_arm")
    _parameters.set_numbers(arm, "fromto", 0, 0, 0, 0, 0, length)
    _parameters.set_numbers(xml_tools.find_element(root, "body", "hand"), "pos", 0, 0, length)


def _set_root_damping(root: Element, damping: float) -> None:
    _parameters.set_numbers(xml_tools.find_element(root, "joint", "arm_root"), "damping", damping)


def _set_shoulder_damping(root: Element, damping: float) -> None:
    joint = xml_tools.find_element(root, "joint", "arm_shoulder")
    _parameters.set_numbers(joint, "damping", damping)


# The same in all combined challenges, which leave the range of the parameter alone.
_ARM_LENGTHS = Range(0.1, 0.25, 0.01)


class Bring(_planar_arm.ArmTask):
    """Bring the prop to the target, which is inside the receptacle in insertion tasks."""

    PERTURBATIONS: ClassVar[Mapping[str, Parameter]] = {
        "lower_arm_length": Parameter(
            _set_lower_arm_length,
            0.12,
            _ARM_LENGTHS,
            _parameters.challenges(_ARM_LENGTHS, _ARM_LENGTHS, _ARM_LENGTHS),
        ),
        "root_damping": Parameter(_set_root_damping, 2.0, Range(0.1, 10.0, 0.1)),
        "shoulder_damping": Parameter(_set_shoulder_damping, 1.5, Range(0.1, 10.0, 0.1)),
    }
    GOAL = ("bringing",)
    STARTS = _STARTS

    def __init__(
        self, use_peg: bool, insert: bool, fully_observable: bool, random: Seed = None
    ) -> None:
        """Creates the task.

        Args:
          use_peg: whether the prop is the peg; otherwise the ball.
          insert: whether the target is inside a receptacle.
          fully_observable: observe hand, prop and target in addition to the arm's sensors.
          random: a `numpy.random.RandomState`, a seed, or None.
        """
        self._use_peg = use_peg
        self._insert = insert
        self.planner_cost = _PLANNER_COSTS[insert]
        self._object = "peg" if use_peg else "ball"
        self._target = f"target_{self._object}"
        self._receptacle = "slot" if use_peg else "cup"
        self._object_joints = [f"{self._object}_{dimension}" for dimension in "xzy"]
        super().__init__(fully_observable, random)

    @property
    def object_joints(self) -> list[str]:
        """Names of the prop's joints: along x, along z and about y."""
        return list(self._object_joints)

    def initialize_episode(self, physics: Physics) -> None:
        """Draws random poses of arm, target and prop, without contacts."""
        self.draw_collision_free_start(physics, lambda: self._draw_start(physics))
        super().initialize_episode(physics)

    def _draw_start(self, physics: Physics) -> None:
        uniform = self.random.uniform
        physics.randomize_arm(self.random)

        x, z = uniform(-0.4, 0.4), uniform(0.1, 0.4)
        angle = uniform(-np.pi / 3, np.pi / 3) if self._insert else uniform(-np.pi, np.pi)
        for body in (self._target, self._receptacle)[: 1 + self._insert]:
            body_pos, body_quat = physics.named.model.body_pos, physics.named.model.body_quat
            body_pos[body, "x"], body_pos[body, "z"] = x, z
            body_quat[body, "qw"], body_quat[body, "qy"] = np.cos(angle / 2), np.sin(angle / 2)

        probabilities = [_P_IN_HAND, _P_IN_TARGET, 1 - _P_IN_HAND - _P_IN_TARGET]
        start = self.random.choice(_STARTS, p=probabilities)
        data = physics.named.data
        if start == "in_hand":
            physics.after_reset()
            x, z = data.site_xpos["grasp", "x"], data.site_xpos["grasp", "z"]
            along_x, along_z = data.site_xmat["grasp", ["xx", "zx"]]
            angle = np.pi - np.arctan2(along_z, along_x)
        elif start == "uniform":
            x, z, angle = uniform(-0.5, 0.5), uniform(0, 0.7), uniform(0, 2 * np.pi)
            # As in dm_control, a rejected attempt keeps the velocity it drew.
            data.qvel[f"{self._object}_x"] = uniform(-5, 5)
        data.qpos[self._object_joints] = x, z, angle

    def start(self, physics: Physics) -> str:
        """The prop's initial position: 'in_hand', 'in_target' or 'uniform'."""
        data = physics.named.data
        position = data.qpos[self._object_joints][:2].tolist()
        # An exact comparison, because nothing has moved since the draw.
        if position == physics.named.model.body_pos[self._target, ["x", "z"]].tolist():
            return "in_target"
        in_hand = position == [data.site_xpos["grasp", "x"], data.site_xpos["grasp", "z"]]
        return "in_hand" if in_hand else "uniform"

    def observe_scene(self, physics: Physics) -> collections.OrderedDict:
        """Pose and velocity of the prop, and the target's pose."""
        obs = collections.OrderedDict()
        obs["object_pos"] = physics.body_2d_pose(self._object)
        obs["object_vel"] = physics.joint_vel(self._object_joints)
        obs["target_pos"] = physics.body_2d_pose(self._target)
        return obs

    def reward_terms(self, physics: Physics) -> dict[str, Quantity]:
        """Closeness of the prop to the target and, for the peg, of the hand to its grasp."""
        if not self._use_peg:
            return {"bringing": is_close(physics.site_distance("ball", "target_ball"))}
        grasp = is_close(physics.site_distance("peg_grasp", "grasp"))
        pinch = is_close(physics.site_distance("peg_pinch", "pinch"))
        centre = is_close(physics.site_distance("peg", "target_peg"))
        tip = is_close(physics.site_distance("target_peg_tip", "peg_tip"))
        return {"grasping": (grasp + pinch) / 2, "bringing": (centre + tip) / 2}

    def reward_of(self, terms: dict[str, Quantity]) -> Quantity:
        """The bringing term; for the peg, a third of the grasping term if that is larger."""
        if not self._use_peg:
            return terms["bringing"]
        bringing, grasping = terms["bringing"], terms["grasping"] / 3
        if isinstance(bringing, float) and isinstance(grasping, float):
            return max(bringing, grasping)  # a float, like dm_control's reward
        return np.maximum(bringing, grasping)
