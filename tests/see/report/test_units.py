"""Names and units of a model's numbers, read from the compiled model."""

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.see.report.units import Label, controls, fields_of

_MODEL = mujoco.MjModel.from_xml_string("""
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
    model = suite.load(domain, task).physics.model._model
    data = mujoco.MjData(model)
    for name, labels in fields_of(model).items():
        assert len(labels) == np.size(getattr(data, name)), name
    assert len(fields_of(model)["sensordata"]) == model.nsensordata
