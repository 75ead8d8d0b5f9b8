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
    law = ControlLaw(env.physics.model._model, Settings(gain=2.0))
    position = env.physics.position()
    # A start may lie beyond the limits of targets only for joints that turn freely.
    asked = law.controls(law.held(position), position, env.physics.velocity())
    np.testing.assert_array_equal(asked, np.zeros(env.physics.model.nu))


def test_a_joint_is_pushed_towards_its_target_and_braked() -> None:
    physics = suite.load("manipulator", "bring_ball").physics
    law = ControlLaw(physics.model._model, Settings(gain=2.0, damping=0.5))
    qpos, qvel = np.zeros(physics.model.nq), np.zeros(physics.model.nv)
    targets = np.array([0.1, 0.0, 0.0, 9.0, -0.3])
    np.testing.assert_allclose(law.controls(targets, qpos, qvel), [0.2, 0, 0, 1.0, -0.3])
    qvel[1] = 0.5
    np.testing.assert_allclose(law.controls(targets, qpos, qvel), [0.2, -0.25, 0, 1.0, -0.3])


def test_a_tendon_of_joints_follows_their_mean_on_request() -> None:
    physics = suite.load("manipulator", "bring_ball").physics
    law = ControlLaw(physics.model._model, Settings(gain=2.0, tendons=True))
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
