"""Tests of limberjack.suite.finger."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import finger

_TURNS = [("turn_easy", 0.07), ("turn_hard", 0.03)]


def turn_to(physics: Any, angle: float) -> None:
    """Turns the body so that its tip is at an angle from the vertical, towards x."""
    physics.named.data.qpos["hinge"] = -angle
    physics.forward()


@pytest.mark.parametrize(
    ("velocity", "reward"), [(-15.0, 1.0), (-40.0, 1.0), (-14.9, 0.0), (0.0, 0.0), (15.0, 0.0)]
)
def test_spinning_backwards_fast_enough_is_rewarded(velocity: float, reward: float) -> None:
    env = suite.load("finger", "spin", {"random": 0})
    env.reset()
    env.physics.named.data.qvel["hinge"] = velocity
    env.physics.forward()
    assert env.physics.hinge_velocity() == velocity
    assert env.task.get_reward(env.physics) == reward


def test_spin_makes_the_hinge_easy_to_turn_and_hides_what_it_does_not_use() -> None:
    env = suite.load("finger", "spin")
    env.reset()
    model = env.physics.named.model
    assert model.dof_damping["hinge"] == 0.03
    np.testing.assert_array_equal(model.site_rgba[["target", "tip"], "a"], 0.0)
    turning = suite.load("finger", "turn_easy")
    turning.reset()
    assert turning.physics.named.model.dof_damping["hinge"] == 0.5
    assert turning.physics.named.model.site_rgba["target", "a"] > 0


@pytest.mark.parametrize(("task", "radius"), _TURNS)
def test_turning_is_rewarded_where_the_tip_is_in_the_target(task: str, radius: float) -> None:
    env = suite.load("finger", task, {"random": 0})
    for _ in range(5):
        env.reset()
        physics = env.physics
        target = np.arctan2(*physics.target_position())
        for arc, is_inside in ((0.0, True), (0.95, True), (-0.95, True), (1.05, False)):
            turn_to(physics, target + 2 * np.arcsin(arc * radius / 2 / 0.13))
            assert physics.dist_to_target() == pytest.approx((abs(arc) - 1) * radius)
            assert env.task.get_reward(physics) == is_inside


@pytest.mark.parametrize(("task", "radius"), _TURNS)
def test_targets_are_drawn_from_the_whole_circle_of_the_tip(task: str, radius: float) -> None:
    env = suite.load("finger", task, {"random": 0})
    angles = []
    for _ in range(200):
        observation = env.reset().observation
        x, z = observation["target_position"]
        assert np.hypot(x, z) == pytest.approx(0.13)
        assert np.linalg.norm(env.physics.tip_position()) == pytest.approx(0.13)
        assert env.physics.named.model.site_size["target", 0] == radius
        angles.append(np.arctan2(x, z))
    counts, _ = np.histogram(angles, 4, (-np.pi, np.pi))
    assert counts.min() > 30


def test_positions_are_relative_to_the_hinge_with_the_tip_in_place_of_its_angle() -> None:
    env = suite.load("finger", "turn_hard", {"random": 0})
    env.reset()
    turn_to(env.physics, 0.3)
    qpos = env.physics.named.data.qpos
    expected = [qpos["proximal"][0], qpos["distal"][0], 0.13 * np.sin(0.3), 0.13 * np.cos(0.3)]
    np.testing.assert_allclose(env.physics.bounded_position(), expected)
    to_target = env.physics.target_position() - expected[2:]
    np.testing.assert_allclose(env.physics.to_target(), to_target)
    env.physics.data.qvel[:] = 1.0, 2.0, 3.0
    env.physics.forward()
    np.testing.assert_array_equal(env.physics.velocity(), [1.0, 2.0, 3.0])


@pytest.mark.parametrize("task", ["spin", "turn_easy"])
def test_a_start_is_at_rest_without_contacts_and_has_any_angles(task: str) -> None:
    env = suite.load("finger", task, {"random": 0})
    seen = []
    for _ in range(100):
        env.reset()
        assert env.physics.data.ncon == 0
        assert not env.physics.data.qvel.any()
        seen.append(env.physics.data.qpos.copy())
    spread = np.ptp(seen, axis=0)
    assert np.all(spread > 0.8 * np.array([*np.ptp(env.physics.model.jnt_range[:2], axis=1), 6]))


def test_the_fingertip_feels_the_body_as_the_logarithm_of_force() -> None:
    physics = finger.Physics.from_xml_string(*finger.get_model_and_assets())
    np.testing.assert_array_equal(physics.touch(), [0.0, 0.0])
    with physics.reset_context():
        physics.named.data.qpos["proximal"] = -0.1  # the tip is inside the body
    force = physics.named.data.sensordata[["touchtop", "touchbottom"]]
    assert force.min() > 1.0
    np.testing.assert_allclose(np.exp(physics.touch()) - 1, force)


def test_a_task_with_another_target() -> None:
    env = suite.load("finger", "turn_easy")
    task = finger.Turn(target_radius=0.2, random=0)
    with env.physics.reset_context():
        task.initialize_episode(env.physics)
    assert env.physics.named.model.site_size["target", 0] == 0.2
