"""The planar arm of the manipulator and the stacker, and the base class of their tasks."""

import collections
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree

import numpy as np

from limberjack import mujoco
from limberjack.suite import base, common
from limberjack.utils import arrays, rewards, xml_tools

__all__ = [
    "CONTROL_TIMESTEP",
    "OBSERVATIONS",
    "TIME_LIMIT",
    "ArmTask",
    "Physics",
    "is_close",
    "model_without",
]

TIME_LIMIT = 10  # seconds
CONTROL_TIMESTEP = 0.01  # seconds
_CLOSE = 0.01  # metres; objects closer than this count as being at the same position

_ARM_JOINTS = [
    "arm_root",
    "arm_shoulder",
    "arm_elbow",
    "arm_wrist",
    "finger",
    "fingertip",
    "thumb",
    "thumbtip",
]
_TOUCH_SENSORS = [
    "palm_touch",
    "finger_touch",
    "thumb_touch",
    "fingertip_touch",
    "thumbtip_touch",
]

OBSERVATIONS = {
    "arm_pos": base.Observed("sine and cosine of the angle of each joint of the arm"),
    "arm_vel": base.Observed("velocities of the arm's joints", "rad/s"),
    "touch": base.Observed(
        "log(1 + force) on palm, finger, thumb, fingertip and thumbtip", "log(1 + N)"
    ),
    "hand_pos": base.Observed(
        "planar pose of the hand: x, z, cosine and sine of half the angle", "m; 1"
    ),
}

_ARM_FILE = "./_planar_arm.xml"


def model_without(filename: str, bodies: Iterable[str]) -> tuple[bytes, dict[str, bytes]]:
    """A suite model without some of its bodies: its MJCF and the files that it includes.

    The arm is part of the MJCF, so that programs which edit it find the arm.
    """
    root = ElementTree.fromstring(common.read_model(filename))
    place = [section.get("file") for section in root].index(_ARM_FILE)
    root[place : place + 1] = ElementTree.fromstring(common.read_model(_ARM_FILE))
    for name in bodies:
        xml_tools.remove_element(root, xml_tools.find_element(root, "body", name))
    return ElementTree.tostring(root), common.ASSETS


def is_close(distance: arrays.Quantity) -> arrays.Quantity:
    """1 up to a distance of 1 cm, 0.1 at 3 cm, (...) metres -> (...)."""
    return rewards.tolerance(distance, (0, _CLOSE), margin=_CLOSE * 2)


class Physics(mujoco.Physics):
    """Measurements of the arm and the objects; planar poses are in the x-z plane."""

    def bounded_joint_pos(self, joint_names: Sequence[str]) -> np.ndarray:
        """Sine and cosine of joint angles, (..., n, 2)."""
        angles = self.named.data.qpos[joint_names]
        return np.stack((np.sin(angles), np.cos(angles)), axis=-1)

    def joint_vel(self, joint_names: Sequence[str]) -> np.ndarray:
        """Velocities of joints, (..., n), radians or metres per second."""
        velocities = self.named.data.qvel[joint_names]
        # Indexing with a list of names gives a copy, with a single name a view.
        return velocities.copy() if isinstance(joint_names, str) else velocities

    def body_2d_pose(self, body_names: str | Sequence[str], orientation: bool = True) -> np.ndarray:
        """Planar poses of bodies: x and z in metres, then the quaternion's w and y.

        Args:
          body_names: one name, for a result of shape (..., 4), or n names, for (..., n, 4).
          orientation: False omits the quaternion.
        """
        names = body_names if isinstance(body_names, str) else list(body_names)
        # Every second element: x and z of a position, w and y of a quaternion.
        position = self.named.data.xpos[names][..., ::2]
        if not orientation:
            return position.copy()
        return arrays.concat((position, self.named.data.xquat[names][..., ::2]))

    def touch(self) -> np.ndarray:
        """Logarithm of one plus the forces on palm, finger, thumb and their tips, (..., 5)."""
        return np.log1p(self.named.data.sensordata[_TOUCH_SENSORS])

    def site_distance(self, site1: str, site2: str) -> arrays.Quantity:
        """Distance between two sites, (...), metres."""
        positions = self.named.data.site_xpos
        return arrays.norm(positions[site1] - positions[site2])

    def randomize_arm(self, random: np.random.RandomState) -> None:
        """Draws the arm's joint angles within their limits, with a symmetric hand."""
        joints = self.named.model
        is_limited = joints.jnt_limited[_ARM_JOINTS][:, None]
        limits = np.where(is_limited, joints.jnt_range[_ARM_JOINTS], [-np.pi, np.pi])
        qpos = self.named.data.qpos
        qpos[_ARM_JOINTS] = random.uniform(limits[:, 0], limits[:, 1])
        qpos["finger"] = qpos["thumb"]


class ArmTask(base.Task[Physics]):
    """A task with the arm, which always observes the arm itself."""

    EPISODE_FIELDS = ("body_pos", "body_quat")  # the target's pose

    def __init__(self, fully_observable: bool, random: base.Seed = None) -> None:
        """Creates the task.

        Args:
          fully_observable: observe hand, objects and target in addition to the arm's sensors.
          random: a `numpy.random.RandomState`, a seed, or None.
        """
        self._fully_observable = fully_observable
        super().__init__(random=random)

    def get_observation(self, physics: Physics) -> collections.OrderedDict:
        """The arm's joints and touch sensors, and the scene if it is fully observable."""
        obs = collections.OrderedDict()
        obs["arm_pos"] = physics.bounded_joint_pos(_ARM_JOINTS)
        obs["arm_vel"] = physics.joint_vel(_ARM_JOINTS)
        obs["touch"] = physics.touch()
        if self._fully_observable:
            obs["hand_pos"] = physics.body_2d_pose("hand")
            obs.update(self.observe_scene(physics))
        return obs

    def observe_scene(self, physics: Physics) -> collections.OrderedDict:
        """Observations of objects and target, by name."""
        raise NotImplementedError(f"{type(self).__name__} does not define observe_scene")
