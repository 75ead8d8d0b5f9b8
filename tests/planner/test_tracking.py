"""Splines of targets, and the law that follows them."""

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.tracking import Tracking, shares_of_knots, targets_at

from .planned import PLANNED


def test_a_spline_passes_its_knots_and_is_straight_between_them() -> None:
    knots = np.array([[0.0, 1.0], [2.0, 1.0], [3.0, -1.0]])
    np.testing.assert_array_equal(targets_at(knots, 0.0), knots[0])
    np.testing.assert_array_equal(targets_at(knots, 1.0), knots[1])
    np.testing.assert_array_equal(targets_at(knots, 2.0), knots[2])
    np.testing.assert_allclose(targets_at(knots, 1.25), [2.25, 0.5])
    np.testing.assert_array_equal(targets_at(knots, 7.0), knots[2])


def test_a_row_of_many_splines_is_that_spline() -> None:
    knots = np.random.default_rng(0).normal(size=(6, 4, 3))
    for place in (0.0, 0.3, 2.9, 3.0):
        rows = targets_at(knots, place)
        for row in range(6):
            np.testing.assert_array_equal(rows[row], targets_at(knots[row], place))


def test_shares_of_knots_make_the_splines_values() -> None:
    knots = np.random.default_rng(0).normal(size=(6, 4, 3))
    places = np.array([0.0, 0.3, 1.0, 2.9, 3.0, 7.0])
    found = shares_of_knots(4, places) @ knots
    # Sums of products, of which all but two are 0: they round.
    np.testing.assert_allclose(found.swapaxes(0, 1), targets_at(knots, places), atol=1e-15)


@pytest.mark.parametrize(("domain", "task"), PLANNED)
def test_targets_that_hold_the_joints_ask_for_nothing(domain: str, task: str) -> None:
    env = suite.load(domain, task, task_kwargs={"random": 0})
    env.reset()
    law = Tracking(env.physics.model._model, gain=2.0, damping=0.0)
    position = env.physics.position()
    # A start may lie beyond the limits of targets only for joints that turn freely.
    asked = law.controls(law.held(position), position, env.physics.velocity())
    np.testing.assert_array_equal(asked, np.zeros(env.physics.model.nu))


def test_a_joint_is_pushed_towards_its_target_and_braked() -> None:
    physics = suite.load("manipulator", "bring_ball").physics
    law = Tracking(physics.model._model, gain=2.0, damping=0.5)
    qpos, qvel = np.zeros(physics.model.nq), np.zeros(physics.model.nv)
    targets = np.array([0.1, 0.0, 0.0, 9.0, -0.3])
    np.testing.assert_allclose(law.controls(targets, qpos, qvel), [0.2, 0, 0, 1.0, -0.3])
    qvel[1] = 0.5
    np.testing.assert_allclose(law.controls(targets, qpos, qvel), [0.2, -0.25, 0, 1.0, -0.3])


def test_a_tendon_of_joints_follows_their_mean_on_request() -> None:
    physics = suite.load("manipulator", "bring_ball").physics
    law = Tracking(physics.model._model, gain=2.0, damping=0.0, tendons=True)
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
    law = Tracking(model, gain=2.0, damping=0.0)
    assert law.follows.tolist() == [False, True]
    controls = law.controls(np.array([0.5, 0.5]), np.array([0.1]), np.zeros(1))
    np.testing.assert_allclose(controls, [0.5, 0.8])
