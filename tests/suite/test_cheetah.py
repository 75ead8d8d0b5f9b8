"""Tests of limberjack.suite.cheetah."""

import re

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import cheetah


@pytest.mark.parametrize(
    ("speed", "reward"), [(10.0, 1.0), (20.0, 1.0), (5.0, 0.5), (0.0, 0.0), (-3.0, 0.0)]
)
def test_forward_speed_is_rewarded_linearly(speed: float, reward: float) -> None:
    env = suite.load("cheetah", "run")
    with env.physics.reset_context():
        env.physics.named.data.qvel["rootx"] = speed
        env.physics.named.data.qvel["rootz"] = 7.0  # does not count
    assert env.physics.speed() == pytest.approx(speed)
    assert env.task.get_reward(env.physics) == pytest.approx(reward)
    assert env.task.is_success(env.task.reward_terms(env.physics)) == (reward > 0.9)


def test_a_start_has_come_to_rest_on_the_ground_and_begins_at_time_zero() -> None:
    env = suite.load("cheetah", "run", {"random": 0})
    for _ in range(30):
        env.reset()
        assert env.physics.time() == 0.0
        assert abs(env.physics.velocity()).max() < 1.0
        assert env.physics.data.ncon > 0
        assert env.physics.data.qacc_warmstart.any()  # of the last settling step


def test_a_start_depends_on_the_angles_drawn_for_the_legs() -> None:
    env = suite.load("cheetah", "run", {"random": 0})
    physics, drawn = env.physics, []
    step = physics.step

    def look_and_step(nstep: int) -> None:
        drawn.append(physics.position())
        step(nstep)

    physics.step = look_and_step
    for _ in range(50):
        env.reset()
    angles = np.array(drawn)
    np.testing.assert_array_equal(angles[:, :3], 0.0)
    lower, upper = physics.model.jnt_range[3:].T
    for bound, extreme in ((lower, angles[:, 3:].min(axis=0)), (upper, angles[:, 3:].max(axis=0))):
        assert (abs(extreme - bound) < 0.2 * (upper - lower)).all()


def test_the_horizontal_position_is_not_observed() -> None:
    env = suite.load("cheetah", "run", {"random": 0})
    observation = env.reset().observation
    np.testing.assert_array_equal(observation["position"], env.physics.data.qpos[1:])
    assert not np.shares_memory(observation["position"], env.physics.data.qpos)


def test_the_masses_are_those_of_the_geoms_scaled_to_14_kg() -> None:
    xml, assets = cheetah.get_model_and_assets()
    of_geoms = cheetah.Physics.from_xml_string(re.sub(rb"<inertial[^>]*/>", b"", xml), assets)
    model, unscaled = cheetah.Physics.from_xml_string(xml, assets).model, of_geoms.model
    assert model.body_mass.sum() == pytest.approx(14)
    scale = 14 / unscaled.body_mass.sum()
    np.testing.assert_allclose(model.body_mass, scale * unscaled.body_mass)
    np.testing.assert_allclose(model.body_inertia, scale * unscaled.body_inertia)
    np.testing.assert_allclose(model.body_ipos, unscaled.body_ipos, atol=1e-12)
