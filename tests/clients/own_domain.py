# type: ignore  (dm_control has no types, and may not be installed)
"""A domain of the program's own, on the suite's base classes, registered with the suite."""

import collections
import json
import sys
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from dm_control import mujoco, suite
from dm_control.mujoco.wrapper import mjbindings
from dm_control.rl import control
from dm_control.suite import base, common
from dm_control.suite.utils import randomizers
from dm_control.utils import containers, rewards, xml_tools
from dm_control.utils import io as resources

XML = """
<mujoco model="double">
  <include file="./common/visual.xml"/>
  <include file="./common/skybox.xml"/>
  <include file="./common/materials.xml"/>
  <option timestep="0.01"/>
  <default><joint damping="0.1"/><geom material="self"/></default>
  <worldbody>
    <light name="light" pos="0 0 6"/>
    <camera name="side" pos="0 -4 1" xyaxes="1 0 0 0 0 1"/>
    <geom name="floor" size="4 4 .2" type="plane" material="grid"/>
    <body name="upper" pos="0 0 2">
      <joint name="shoulder" type="hinge" axis="0 1 0"/>
      <geom name="upper" fromto="0 0 0 0 0 -.6" size=".05" type="capsule"/>
      <body name="lower" pos="0 0 -.6">
        <joint name="elbow" type="hinge" axis="0 1 0" limited="true" range="-90 90"/>
        <geom name="lower" fromto="0 0 0 0 0 -.6" size=".04" type="capsule"/>
        <site name="tip" pos="0 0 -.6"/>
      </body>
    </body>
    <body name="unused"><geom name="unused" size=".1" pos="2 0 1"/></body>
  </worldbody>
  <actuator>
    <motor name="elbow" joint="elbow" ctrllimited="true" ctrlrange="-2 2" gear="3"/>
  </actuator>
  <sensor><framelinvel name="tip_velocity" objtype="site" objname="tip"/></sensor>
</mujoco>
"""

SUITE = containers.TaggedTasks()


@SUITE.add("custom")
def swing(
    time_limit: float = 2, random: Any = None, environment_kwargs: dict | None = None
) -> control.Environment:
    root = ElementTree.fromstring(XML)
    world = root.find("worldbody")
    world.remove(xml_tools.find_element(root, "body", "unused"))
    xml_tools.find_element(root, "joint", "shoulder").set("damping", "0.2")
    physics = Physics.from_xml_string(ElementTree.tostring(root), common.ASSETS)
    return control.Environment(
        physics,
        Swing(random=random),
        time_limit=time_limit,
        control_timestep=0.02,
        **(environment_kwargs or {}),
    )


class Physics(mujoco.Physics):
    def tip_height(self) -> float:
        return self.named.data.site_xpos["tip", "z"]

    def tip_speed(self) -> float:
        return np.linalg.norm(self.named.data.sensordata["tip_velocity"])


class Swing(base.Task):
    def __init__(self, random: Any = None) -> None:
        self._height = 2.8
        super().__init__(random=random)

    def initialize_episode(self, physics: Any) -> None:
        randomizers.randomize_limited_and_rotational_joints(physics, self.random)
        physics.named.data.qvel["shoulder"] = self.random.randn()
        super().initialize_episode(physics)

    def get_observation(self, physics: Any) -> Any:
        observation = collections.OrderedDict()
        observation["angles"] = physics.data.qpos.copy()
        observation["velocity"] = physics.velocity().copy()
        observation["height"] = physics.tip_height()
        return observation

    def get_reward(self, physics: Any) -> Any:
        high = rewards.tolerance(physics.tip_height(), (self._height, float("inf")), margin=2.0)
        return high * (1 + rewards.tolerance(physics.tip_speed(), margin=3.0)) / 2

    def get_termination(self, physics: Any) -> float | None:
        return 0.0 if physics.tip_height() < 0.85 else None


def model_facts(physics: Any) -> dict[str, Any]:
    joint = mjbindings.enums.mjtObj.mjOBJ_JOINT
    assert isinstance(physics, mujoco.Physics)
    return {
        "names": [physics.model.id2name(i, joint) for i in range(physics.model.njnt)],
        "id": physics.model.name2id("elbow", "joint"),
        "damping": physics.named.model.dof_damping["shoulder"].tolist(),
        "range": physics.named.model.jnt_range["elbow"].tolist(),
        "bodies": physics.model.nbody,
        "timestep": physics.model.opt.timestep,
        "ptr": physics.model.ptr.nq + physics.data.ptr.qpos.size,
    }


def read_from_a_file() -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_text(XML)
        assert resources.GetResource(str(path)) == XML.encode()
        assert common.read_model(str(path)) == XML.encode()
        with resources.GetResourceAsFile(str(path)) as file:
            tree = xml_tools.parse(file)
        return tree.getroot().get("model")


def main() -> None:
    suite._DOMAINS["double"] = sys.modules[__name__]
    env = suite.load("double", "swing", task_kwargs={"random": 4}, visualize_reward=True)
    print(json.dumps({"facts": model_facts(env.physics), "model": read_from_a_file()}))
    random = np.random.RandomState(1)
    for _ in range(3):
        step = env.reset()
        while not step.last():
            step = env.step(random.uniform(-2, 2, 1))
            values = {key: np.asarray(v).tolist() for key, v in step.observation.items()}
            print(json.dumps({"reward": float(step.reward), "discount": step.discount, **values}))
    colour = env.physics.named.model.mat_rgba["self"].tolist()
    print(json.dumps({"colour": colour, "warnings": int(env.physics.data.warning.number.sum())}))


if __name__ == "__main__":
    main()
