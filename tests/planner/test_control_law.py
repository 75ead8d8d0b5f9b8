"""The law that follows targets."""

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import Settings
from limberjack.planner.control_law import ControlLaw, joints_of_tendon

from .planned import PLANNED


@pytest.mark.parametrize(("domain", "task"), PLANNED)
def test_targets_that_hold_the_joints_ask_for_nothing(domain: str, task: str) -> None:
    env = suite.load(domain, task, task_kwargs={"random": 0})
    env.reset()
    law = ControlLaw(env.physics.model._official, Settings(gain=2.0))
    position = env.physics.position()
    # A start may lie beyond the limits of targets only for joints that turn freely.
    asked = law.controls(law.held(position), position, env.physics.velocity())
    np.testing.assert_array_equal(asked, np.zeros(env.physics.model.nu))


def test_a_joint_is_pushed_towards_its_target_and_braked() -> None:
    physics = suite.load("manipulator", "bring_ball").physics
    law = ControlLaw(physics.model._official, Settings(gain=2.0, damping=0.5))
    qpos, qvel = np.zeros(physics.model.nq), np.zeros(physics.model.nv)
    targets = np.array([0.1, 0.0, 0.0, 9.0, -0.3])
    np.testing.assert_allclose(law.controls(targets, qpos, qvel), [0.2, 0, 0, 1.0, -0.3])
    qvel[1] = 0.5
    np.testing.assert_allclose(law.controls(targets, qpos, qvel), [0.2, -0.25, 0, 1.0, -0.3])


def test_a_tendon_of_joints_follows_their_mean_on_request() -> None:
    physics = suite.load("manipulator", "bring_ball").physics
    law = ControlLaw(physics.model._official, Settings(gain=2.0, tendons=True))
    qpos, qvel = np.zeros(physics.model.nq), np.zeros(physics.model.nv)
    names = [physics.model.id2name(joint, "joint") for joint in range(physics.model.njnt)]
    qpos[names.index("thumb")], qpos[names.index("finger")] = 0.3, 0.1
    assert law.follows.tolist() == [True] * 5
    np.testing.assert_allclose(law.held(qpos)[4], 0.2)
    np.testing.assert_allclose(law.controls(np.full(5, 0.1), qpos, qvel), [0.2] * 4 + [-0.2])


def test_a_servo_and_a_tendon_take_their_target_as_control() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco>
        <worldbody><body><joint name="a"/><geom size="1"/></body></worldbody>
        <actuator><position joint="a" kp="3"/><motor joint="a"/></actuator>
      </mujoco>""")
    law = ControlLaw(model, Settings(gain=2.0))
    assert law.follows.tolist() == [False, True]
    controls = law.controls(np.array([0.5, 0.5]), np.array([0.1]), np.zeros(1))
    np.testing.assert_allclose(controls, [0.5, 0.8])


def test_a_fixed_tendon_couples_its_joints_and_a_spatial_one_none() -> None:
    model = mujoco.MjModel.from_xml_string("""
      <mujoco>
        <worldbody>
          <site name="fixed"/>
          <body><joint name="a"/><geom size="1"/><site name="moved" pos="1 0 0"/>
            <body><joint name="b"/><geom size="1"/></body>
          </body>
        </worldbody>
        <tendon>
          <spatial><site site="fixed"/><site site="moved"/></spatial>
          <fixed><joint joint="b" coef="0.5"/><joint joint="a" coef="-2"/></fixed>
        </tendon>
      </mujoco>""")
    found = [joints_of_tendon(model, tendon) for tendon in range(2)]
    assert found == [[], [(1, 0.5), (0, -2.0)]]


_ARM = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body>
      <joint name="narrow" axis="0 1 0" range="-0.4 0.4" limited="true" damping="0.5"/>
      <geom type="sphere" size="0.1" mass="2"/>
      <body pos="1 0 0">
        <joint name="wide" axis="0 1 0" range="-3 3" limited="true"/>
        <geom type="sphere" size="0.1" mass="2"/>
      </body>
    </body>
    <body pos="0 9 0">
      <joint name="free" axis="0 1 0"/>
      <geom type="sphere" size="0.1" mass="2"/>
    </body>
    <body pos="0 18 0">
      <joint name="rail" type="slide" axis="1 0 0" range="-2 2" limited="true" damping="0.5"/>
      <geom type="sphere" size="0.1" mass="2"/>
    </body>
  </worldbody>
  <actuator>
    <motor joint="narrow" gear="10" ctrlrange="-1 1" ctrllimited="true"/>
    <motor joint="wide" gear="-10" ctrlrange="-2 2" ctrllimited="true"/>
    <motor joint="free" ctrlrange="-3 3" ctrllimited="true"/>
    <motor joint="rail" gear="5"/>
  </actuator>
</mujoco>
"""


def test_constants_that_are_left_open_come_from_ranges_and_gears() -> None:
    model = mujoco.MjModel.from_xml_string(_ARM)
    law = ControlLaw(model, Settings())
    np.testing.assert_array_equal(law.follows, [True, True, False, True])
    # Full control at a quarter of the range, which is at most half a radian of a hinge's. The
    # expected figures are decimals, and MuJoCo's from degrees: default tolerances in this file.
    np.testing.assert_allclose(law.gain, [1 / 0.2, -2 / 0.5, 1.0, 1 / 1.0])
    # The rail carries 2 kg: half of critical damping is sqrt(1 * 5 * 2), less 0.5, over the gear.
    assert law.damping[3] == pytest.approx((np.sqrt(10) - 0.5) / 5)
    assert law.damping[1] < 0.0  # as its gear
    assert law.damping[2] == 0.0
    np.testing.assert_array_equal(law.scale, [0.4, 3.0, 3.0, 2.0])
    assert law.noise == 1.0
    # Targets end where the joint is pressed against its limit with full control.
    far = np.full(4, 99.0)
    np.testing.assert_allclose(law.within_limits(far), [0.6, 3.25, 3.0, 3.0])


def test_a_derived_law_turns_joints_to_their_targets() -> None:
    model = mujoco.MjModel.from_xml_string(_ARM)
    model.opt.gravity[:] = 0.0
    law, data = ControlLaw(model, Settings()), mujoco.MjData(model)
    targets = np.array([0.2, -1.0, 0.0, 0.5])
    for _ in range(5000):
        data.ctrl = law.controls(targets, data.qpos, data.qvel)
        mujoco.mj_step(model, data)
    # Motion dies out exponentially: what is left after 5,000 steps.
    np.testing.assert_allclose(data.qpos[[0, 1, 3]], targets[[0, 1, 3]], atol=0.01)


def test_a_gain_that_is_given_is_damped_by_the_model() -> None:
    model = mujoco.MjModel.from_xml_string(_ARM)
    law = ControlLaw(model, Settings(gain=4.0, noise=0.3))
    assert law.follows.all()  # also the joint without limits
    assert law.damping[3] == pytest.approx((np.sqrt(4 * 5 * 2) - 0.5) / 5)
    np.testing.assert_array_equal(law.scale, np.ones(4))
    assert law.noise == 0.3


def test_a_motor_that_turns_its_joint_backwards_pushes_to_the_target() -> None:
    model = mujoco.MjModel.from_xml_string(_ARM)
    model.opt.gravity[:] = 0.0
    law = ControlLaw(model, Settings(gain=4.0, damping=0.5))
    backwards = model.actuator_gear[:, 0] < 0
    assert backwards.sum() == 1
    np.testing.assert_array_equal(law.gain, np.where(backwards, -4.0, 4.0))
    np.testing.assert_array_equal(law.damping, np.where(backwards, -0.5, 0.5))


def test_the_targets_of_controls_ask_for_these_controls() -> None:
    model = mujoco.MjModel.from_xml_string(_ARM)
    law = ControlLaw(model, Settings())
    qpos, qvel = np.array([0.1, -0.5, 2.0, 0.3]), np.array([0.4, 1.0, -2.0, -0.2])
    controls = np.array([0.3, -0.8, 1.5, 0.2])
    targets = law.targets_of(controls, qpos, qvel)
    assert targets[2] == 1.5  # its control
    np.testing.assert_allclose(law.controls(targets, qpos, qvel), controls)
