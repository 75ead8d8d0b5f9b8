"""Tasks like those of ALOHA's simulation (tonyzhaozh/act), whose actions differ from the controls.

Two arms with six joints and two fingers each have 16 actuators; an action of 14 numbers has one
number for both fingers of a hand. In a second task the hands are mocap bodies with 4 actuators for
the fingers; an action of 16 numbers has a position, a quaternion and one number for the fingers of
each hand.
"""

import collections
from typing import Any

import numpy as np

__all__ = ["by_joints", "by_pose"]

_ARM_JOINTS = 6
_FINGERS = 2


def _joints_xml() -> str:
    arms, motors = "", ""
    for side, x in (("left", -1), ("right", 1)):
        inner = ""
        for finger, y in (("a", 0.05), ("b", -0.05)):
            inner += (
                f'<body pos="0 {y} .1"><joint name="{side}_{finger}" type="slide" axis="0 1 0" '
                'damping="1"/><geom size=".02" mass=".1"/></body>'
            )
        for link in reversed(range(_ARM_JOINTS)):
            axis = "0 1 0" if link % 2 else "0 0 1"
            inner = (
                f'<body pos="0 0 .2"><joint name="{side}_{link}" axis="{axis}" damping="2"/>'
                f'<geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass="1"/>{inner}</body>'
            )
        arms += f'<body pos="{x} 0 0">{inner}</body>'
        for joint in [*map(str, range(_ARM_JOINTS)), "a", "b"]:
            motors += (
                f'<position joint="{side}_{joint}" kp="20" ctrllimited="true" ctrlrange="-3 3"/>'
            )
    return (
        '<mujoco><option timestep="0.005"/><default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{arms}</worldbody><actuator>{motors}</actuator></mujoco>"
    )


def _pose_xml() -> str:
    bodies, welds, motors = "", "", ""
    for side, x in (("left", -0.5), ("right", 0.5)):
        fingers = "".join(
            f'<body pos="0 {y} .1"><joint name="{side}_{finger}" type="slide" axis="0 1 0" '
            'damping="1"/><geom size=".02" mass=".1"/></body>'
            for finger, y in (("a", 0.05), ("b", -0.05))
        )
        bodies += (
            f'<body name="{side}_target" mocap="true" pos="{x} 0 1"/><body name="{side}" '
            f'pos="{x} 0 1"><freejoint/><geom size=".05" mass="1"/>{fingers}</body>'
        )
        welds += f'<weld body1="{side}_target" body2="{side}"/>'
        motors += "".join(
            f'<position joint="{side}_{finger}" kp="20" ctrllimited="true" ctrlrange="-.1 .1"/>'
            for finger in "ab"
        )
    return (
        '<mujoco><option timestep="0.005"/><default><geom contype="0" conaffinity="0"/></default>'
        f"<worldbody>{bodies}</worldbody><equality>{welds}</equality>"
        f"<actuator>{motors}</actuator></mujoco>"
    )


def _task_class(base: Any) -> Any:
    class TwoArms(base.Task):
        def initialize_episode(self, physics: Any) -> None:
            physics.data.qpos[-4:] = self.random.uniform(-0.02, 0.02, 4)
            super().initialize_episode(physics)

        def get_observation(self, physics: Any) -> Any:
            obs = collections.OrderedDict()
            obs["qpos"] = physics.data.qpos[..., :].copy()
            obs["qvel"] = physics.data.qvel[..., :].copy()
            return obs

        def get_reward(self, physics: Any) -> Any:
            return -np.square(physics.data.qvel).sum(axis=-1)

    return TwoArms


def by_joints(package: Any, spec: Any = None) -> Any:
    """An environment whose actions are 14 numbers for 16 actuators.

    Args:
      package: gives a package's modules by name; see `oracle`.
      spec: the action spec that the task defines; None to inherit that of `base.Task`.
    """
    base = package("suite.base")

    class ByJoints(_task_class(base)):
        def before_step(self, action: Any, physics: Any) -> None:
            halves = []
            for arm in (action[..., :7], action[..., 7:14]):
                grip = arm[..., 6:7]
                halves += [arm[..., :6], grip, -grip]
            super().before_step(np.concatenate(halves, axis=-1), physics)

    return _environment(package, _joints_xml(), ByJoints, spec)


def by_pose(package: Any, spec: Any = None) -> Any:
    """An environment whose actions are 16 numbers for two mocap bodies and 4 actuators."""
    base = package("suite.base")

    class ByPose(_task_class(base)):
        def before_step(self, action: Any, physics: Any) -> None:
            half = action.shape[-1] // 2
            grips = []
            for number, arm in enumerate((action[..., :half], action[..., half:])):
                physics.data.mocap_pos[..., number, :] = arm[..., :3]
                physics.data.mocap_quat[..., number, :] = arm[..., 3:7]
                grips += [arm[..., 7:8], -arm[..., 7:8]]
            super().before_step(np.concatenate(grips, axis=-1), physics)

    return _environment(package, _pose_xml(), ByPose, spec)


def _environment(package: Any, xml: str, task_class: Any, spec: Any) -> Any:
    if spec is not None:
        task_class.action_spec = lambda self, physics: spec
    physics = package("mujoco").Physics.from_xml_string(xml)
    control = package("rl.control")
    return control.Environment(physics, task_class(random=5), time_limit=1, n_sub_steps=4)
