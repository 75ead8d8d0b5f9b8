"""Tests of limberjack.suite.pendulum."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import pendulum


def set_angle(physics: Any, degrees: float, velocity: float = 0.0) -> None:
    """Turns the pole to an angle from upright."""
    with physics.reset_context():
        physics.data.qpos[0] = np.deg2rad(degrees)
        physics.data.qvel[0] = velocity


@pytest.mark.parametrize("degrees", [0, 30, -30, 90, -135, 180])
def test_the_orientation_is_cosine_and_sine_of_the_angle_from_upright(degrees: float) -> None:
    env = suite.load("pendulum", "swingup")
    set_angle(env.physics, degrees, velocity=1.5)
    angle = np.deg2rad(degrees)
    expected = [np.cos(angle), np.sin(angle)]
    observation = env.task.get_observation(env.physics)
    np.testing.assert_allclose(observation["orientation"], expected, atol=1e-15)
    np.testing.assert_array_equal(observation["velocity"], [1.5])
    assert env.physics.pole_vertical() == observation["orientation"][0]
    mass = env.physics.named.data.geom_xpos["mass"]
    np.testing.assert_allclose(mass, [expected[1] / 2, 0, 0.6 + expected[0] / 2], atol=1e-15)


@pytest.mark.parametrize(
    ("degrees", "reward"), [(0, 1), (7.9, 1), (-7.9, 1), (8.1, 0), (-8.1, 0), (90, 0), (180, 0)]
)
def test_only_a_pole_within_8_degrees_of_the_vertical_is_rewarded(
    degrees: float, reward: float
) -> None:
    env = suite.load("pendulum", "swingup")
    set_angle(env.physics, degrees, velocity=3.0)  # the velocity does not count
    found = env.task.get_reward(env.physics)
    assert type(found) is float
    assert found == reward
    assert env.task.is_success(env.task.reward_terms(env.physics)) == bool(reward)


def test_a_constant_torque_does_not_lift_the_pole_but_swinging_does() -> None:
    env = suite.load("pendulum", "swingup", {"random": 0})
    heights: dict[str, float] = {}
    for policy in ("constant", "swinging"):
        env.reset()
        set_angle(env.physics, 180)
        heights[policy] = -1.0
        for _ in range(999):
            velocity = env.physics.angular_velocity()
            env.step(np.where(velocity < 0, -1.0, 1.0) if policy == "swinging" else [1.0])
            heights[policy] = max(heights[policy], float(env.physics.pole_vertical()))
    assert heights["constant"] < -0.5
    assert heights["swinging"] > pendulum._COSINE_BOUND


def test_a_start_is_any_angle_at_rest() -> None:
    env = suite.load("pendulum", "swingup", {"random": 0})
    angles = []
    for _ in range(400):
        env.reset()
        assert not env.physics.angular_velocity().any()
        angles.append(env.physics.position()[0])
    quarters, _ = np.histogram(angles, 4, range=(-np.pi, np.pi))
    assert quarters.sum() == 400
    assert quarters.min() > 60  # of 100 expected; four standard deviations are 35


def test_mujoco_computes_the_energy() -> None:
    physics = suite.load("pendulum", "swingup").physics
    set_angle(physics, 0, velocity=2.0)
    moment = 0.5**2 + 2 / 5 * 0.05**2  # of 1 kg in a ball of 5 cm, 50 cm from the hinge
    np.testing.assert_allclose(physics.data.energy, [9.81 * 1.1, moment * 2.0**2 / 2])


def test_the_velocity_is_a_copy() -> None:
    physics = suite.load("pendulum", "swingup").physics
    set_angle(physics, 0, velocity=2.0)
    velocity = physics.angular_velocity()
    velocity[:] = 5.0
    assert physics.velocity()[0] == 2.0


def test_the_model_is_given_with_the_files_it_includes() -> None:
    physics = pendulum.Physics.from_xml_string(*pendulum.get_model_and_assets())
    assert physics.model.name == "pendulum"
    assert (physics.model.nq, physics.model.nv, physics.model.nu) == (1, 1, 1)
