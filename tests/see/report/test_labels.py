"""Names of observations and actions, found without a declaration, and their units."""

import collections
import sys
from types import ModuleType
from typing import Any

import mujoco as official
import numpy as np
import pytest

from limberjack import mujoco, suite
from limberjack.rl import control
from limberjack.see.report import labels_of
from limberjack.see.report.labels import Label, controls, fields_of
from limberjack.suite import base
from tests import plain_domain

_MODEL = official.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body name="base" mocap="true"><site name="tip"/></body>
    <body name="cart">
      <joint name="rail" type="slide"/>
      <geom size="0.1"/>
      <body>
        <joint name="hinge"/>
        <geom size="0.1"/>
      </body>
    </body>
    <body name="ball"><joint name="spin" type="ball"/><geom size="0.1"/></body>
    <body name="drone"><freejoint name="free"/><geom size="0.1"/></body>
  </worldbody>
  <tendon><fixed name="belt"><joint joint="hinge" coef="1"/></fixed></tendon>
  <actuator>
    <motor name="push" joint="rail" gear="3"/>
    <motor name="turn" joint="hinge" gear="-2"/>
    <position name="aim" joint="hinge" kp="5"/>
    <position name="move" joint="rail"/>
    <velocity name="whirl" joint="hinge" kv="2"/>
    <position name="geared" joint="hinge" gear="4"/>
    <motor name="pull" tendon="belt" gear="2"/>
    <motor joint="hinge"/>
    <muscle name="muscle" joint="hinge" lengthrange="0.1 1"/>
  </actuator>
  <sensor>
    <jointpos name="reach" joint="rail"/>
    <jointvel name="rate" joint="hinge"/>
    <gyro name="gyro" site="tip"/>
    <framequat name="pose" objtype="site" objname="tip"/>
    <touch site="tip"/>
    <user name="own" dim="2"/>
  </sensor>
</mujoco>
""")


def _texts(environment: control.Environment) -> dict[str, list[str]]:
    labels = labels_of(environment)
    return {name: list(map(str, of)) for name, of in labels.observations.items()}


# Numbers of which each depends on several objects, such as the difference of two positions in the
# frame of a third: charts show their places in the observation.
_OF_SEVERAL = {
    "dog": ["torso_com_velocity", "target_position"],
    "finger": ["position", "target_position", "dist_to_target"],
    "fish": ["target"],
    "quadruped": ["origin", "target_position", "ball_state"],
    "reacher": ["to_target"],
    "swimmer": ["to_target"],
}


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_every_number_that_a_task_observes_has_a_name_of_its_own(domain: str, task: str) -> None:
    env = suite.load(domain, task, {"random": 0})
    observation = env.reset().observation
    labels = labels_of(env)
    for name in observation.keys() - _OF_SEVERAL.get(domain, []):
        value, of_value = observation[name], labels.observations[name]
        assert len(set(of_value)) == len(of_value) == np.size(value)
        assert not any(label.name.isdigit() for label in of_value), name
    assert len(labels.actions) == env.action_spec().shape[0]


def test_names_are_those_of_the_model() -> None:
    humanoid = _texts(suite.load("humanoid", "walk"))
    assert humanoid["joint_angles"][0] == "abdomen_z [rad]"
    assert humanoid["head_height"] == ["head z [m]"]
    assert humanoid["torso_vertical"] == ["torso zx", "torso zy", "torso zz"]
    # Computed from several bodies: named after the one that is not shared.
    limbs = ("left_hand", "left_foot", "right_hand", "right_foot")
    assert humanoid["extremities"] == [f"{limb} {axis} [m]" for limb in limbs for axis in "xyz"]
    manipulator = _texts(suite.load("manipulator", "bring_ball"))
    assert manipulator["arm_pos"][:2] == ["sin arm_root", "cos arm_root"]
    assert manipulator["touch"][0] == "log(1 + palm_touch [N])"
    assert manipulator["object_pos"] == ["ball x [m]", "ball z [m]", "ball qw", "ball qy"]


def test_joined_observations_have_the_same_names_in_their_order() -> None:
    flat = suite.load("manipulator", "bring_ball", environment_kwargs={"flat_observation": True})
    apart = _texts(suite.load("manipulator", "bring_ball"))
    assert _texts(flat) == {"observations": [name for names in apart.values() for name in names]}


def test_a_domain_of_ones_own_needs_no_declaration() -> None:
    labels = labels_of(plain_domain.push())
    assert list(map(str, labels.observations["place"])) == ["slide [m]"]
    assert list(map(str, labels.observations["speed"])) == ["slide [m/s]"]
    assert [label.name for label in labels.observations["fast"]] == ["slide"]
    assert labels.actions == ()  # one action drives two actuators


def test_numbers_without_a_unit_of_the_model_have_the_one_that_the_domain_declares() -> None:
    finger = suite.load("finger", "turn_easy")
    apart = _texts(finger)
    assert apart["target_position"] == ["0 [m]", "1 [m]"]
    assert apart["dist_to_target"] == ["dist_to_target [m]"]
    assert apart["position"][2:] == ["2", "3"]  # angles and positions have several units
    flat = suite.load("finger", "turn_easy", environment_kwargs={"flat_observation": True})
    assert _texts(flat)["observations"][-3:] == ["9 [m]", "10 [m]", "11 [m]"]
    escape = _texts(suite.load("quadruped", "escape"))
    assert escape["rangefinder"][0] == "rf_00 [tanh(m)]"
    assert escape["force_torque"][0] == "force_toe_front_left x"  # forces and torques


def test_units_are_declared_in_the_module_of_the_task_and_in_those_of_its_bases(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = ModuleType("declares")
    vars(module)["OBSERVATIONS"] = {
        "to_target": base.Observed("the same in another unit", "dm"),
        "finger_to_target": "no declaration",
    }
    monkeypatch.setitem(sys.modules, "declares", module)
    env = suite.load("reacher", "easy")
    parent = type(env.task)
    env.task.__class__ = type("Reacher", (parent,), {"__module__": "declares"})
    assert _texts(env)["to_target"] == ["0 [dm]", "1 [dm]"]
    vars(module)["OBSERVATIONS"] = ["not a mapping"]
    assert _texts(env)["to_target"] == ["0 [m]", "1 [m]"]


def test_looking_for_labels_changes_nothing() -> None:
    env = suite.load("stacker", "stack_2", {"random": 3})
    env.reset()
    env.step(np.full(5, 0.5))
    task, observe = env.task, env.task.get_observation
    task.get_observation = lambda physics: {"noise": task.random.uniform(), **observe(physics)}
    before = env.snapshot()
    labels_of(env)
    after = env.snapshot()
    for name, values in before.physics.items():
        np.testing.assert_array_equal(after.physics[name], values)
    np.testing.assert_equal(after.streams, before.streams)


class _Counting(base.Task):
    observed = 0

    def get_observation(self, physics: Any) -> Any:
        self.observed += 1
        return {"angle": physics.position()}


def test_looking_for_labels_leaves_no_trace_in_the_task() -> None:
    env = control.Environment(suite.load("pendulum", "swingup").physics, _Counting(random=0))
    assert [label.name for label in labels_of(env).observations["angle"]] == ["hinge"]
    assert env.task.observed == 0


def test_numbers_that_depend_on_no_single_object_keep_their_index() -> None:
    env = suite.load("humanoid", "walk")
    env.task.get_observation = lambda physics: collections.OrderedDict(
        mixed=np.array([physics.data.qpos[7:].sum(), physics.data.qpos[8]])
    )
    assert _texts(env) == {"mixed": ["0", "abdomen_y [rad]"]}


class _Looking(base.Task):
    looks = 0

    def get_observation(self, physics: Any) -> Any:
        _Looking.looks += 1
        eye = np.full((84, 84, 3), physics.position()[0])
        return {"eye": eye, "energy": physics.velocity() ** 2, "angle": physics.position()}


def test_a_picture_has_no_labels_and_is_not_drawn_for_each_number_of_the_state() -> None:
    env = control.Environment(suite.load("pendulum", "swingup").physics, _Looking(random=0))
    env.reset()
    _Looking.looks = 0
    assert _texts(env) == {"angle": ["hinge [rad]"]}
    assert _Looking.looks <= 3


def test_a_task_that_cannot_observe_the_copy_has_no_labels() -> None:
    physics = mujoco.Physics.from_xml_string(plain_domain._MODEL)
    offsets = {id(physics): 1.0}  # which has none of a copy

    class Task(plain_domain.Push):
        def get_observation(self, physics: Any) -> Any:
            return {"place": physics.data.qpos + offsets[id(physics)]}

    env = control.Environment(physics, Task())
    env.reset()
    assert labels_of(env).observations == {}


def test_a_physics_without_a_model_has_no_labels() -> None:
    env = suite.load("humanoid", "walk")
    env._physics = object()  # pyright: ignore[reportAttributeAccessIssue]
    assert labels_of(env) == ({}, ())


def test_positions_and_velocities_are_named_after_joints() -> None:
    found = fields_of(_MODEL)
    assert list(map(str, found["qpos"])) == [
        *("rail [m]", "hinge [rad]"),
        *("spin qw", "spin qx", "spin qy", "spin qz"),
        *("free x [m]", "free y [m]", "free z [m]", "free qw", "free qx", "free qy", "free qz"),
    ]
    assert list(map(str, found["qvel"])) == [
        *("rail [m/s]", "hinge [rad/s]"),
        *(f"spin about {axis} [rad/s]" for axis in "xyz"),
        *(f"free {axis} [m/s]" for axis in "xyz"),
        *(f"free about {axis} [rad/s]" for axis in "xyz"),
    ]


def test_the_unit_of_a_control_is_what_1_stands_for() -> None:
    assert list(map(str, controls(_MODEL))) == [
        *("push [3 N]", "turn [-2 N·m]", "aim [rad]", "move [m]", "whirl [rad/s]"),
        *("geared", "pull", "actuator 7 [1 N·m]", "muscle"),
    ]


def test_sensors_have_the_units_of_their_kind_and_joint() -> None:
    assert list(map(str, fields_of(_MODEL)["sensordata"])) == [
        *("reach [m]", "rate [rad/s]", "gyro x [rad/s]", "gyro y [rad/s]", "gyro z [rad/s]"),
        *("pose qw", "pose qx", "pose qy", "pose qz", "sensor 4 [N]", "own 0", "own 1"),
    ]


def test_objects_are_named_and_those_without_a_name_are_numbered() -> None:
    found = fields_of(_MODEL)
    assert found["xpos"][3:6] == [Label(f"base {axis}", "m") for axis in "xyz"]
    assert found["xmat"][9 * 3 + 8] == Label("body 3 zz", "")
    assert found["mocap_pos"] == [Label(f"base {axis}", "m") for axis in "xyz"]
    assert found["site_xpos"][2] == Label("tip z", "m")
    assert found["ten_length"] == [Label("belt", "")]


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_every_number_of_a_field_has_a_label(domain: str, task: str) -> None:
    model = suite.load(domain, task).physics.model._official
    data = official.MjData(model)
    for name, labels in fields_of(model).items():
        assert len(labels) == np.size(getattr(data, name)), name
    assert len(fields_of(model)["sensordata"]) == model.nsensordata
