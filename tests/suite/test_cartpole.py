"""Tests of limberjack.suite.cartpole."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import cartpole

_DENSE = ["balance", "swingup", "two_poles", "three_poles"]


def set_state(physics: Any, cart: float, angles: Sequence[float], velocity: float = 0.0) -> None:
    """Puts the cart somewhere; each pole's angle is relative to the one before."""
    with physics.reset_context():
        physics.data.qpos[:] = [cart, *angles]
        physics.data.qvel[1:] = velocity


@pytest.mark.parametrize(("task", "poles"), [("balance", 1), ("two_poles", 2), ("three_poles", 3)])
def test_upright_and_still_at_the_centre_is_fully_rewarded(task: str, poles: int) -> None:
    env = suite.load("cartpole", task)
    set_state(env.physics, 0.0, [0.0] * poles)
    assert env.task.get_reward(env.physics) == 1.0
    assert env.task.is_success(env.task.reward_terms(env.physics))
    set_state(env.physics, 0.0, [np.pi] + [0.0] * (poles - 1))  # hanging
    assert env.task.get_reward(env.physics) == pytest.approx(0.0)


@pytest.mark.parametrize("task", _DENSE)
def test_each_departure_from_the_goal_lowers_its_own_term(task: str) -> None:
    env = suite.load("cartpole", task)
    poles = env.physics.model.nv - 1
    straight = [0.0] * poles
    for (cart, angles, velocity, effort), name, value in [
        ((2.0, straight, 0.0, 0.0), "centered", 0.55),
        ((-2.0, straight, 0.0, 0.0), "centered", 0.55),
        ((0.0, [np.pi / 2, *straight[1:]], 0.0, 0.0), "upright", 0.5),
        ((0.0, straight, -5.0, 0.0), "small_velocity", 0.55),
        ((0.0, straight, 0.0, -1.0), "small_control", 0.8),
    ]:
        set_state(env.physics, cart, angles, velocity)
        env.physics.set_control([effort])
        terms = env.task.reward_terms(env.physics)
        assert terms.pop(name) == pytest.approx(value)
        assert list(terms.values()) == [1.0] * 3


def test_the_fastest_pole_and_the_mean_of_the_angles_count() -> None:
    env = suite.load("cartpole", "three_poles")
    set_state(env.physics, 0.0, [0.0, 0.0, np.pi])  # only the last one hangs
    env.physics.data.qvel[2] = 5.0
    terms = env.task.reward_terms(env.physics)
    assert terms["upright"] == pytest.approx(2 / 3)
    assert terms["small_velocity"] == pytest.approx(0.55)


@pytest.mark.parametrize("kwargs", [{}, {"num_poles": 2}, {"num_poles": 4}])
def test_the_sparse_reward_needs_all_poles_and_the_cart_within_bounds(kwargs: Any) -> None:
    env = suite.load("cartpole", "three_poles", {"sparse": True, **kwargs})
    poles = env.physics.model.nv - 1
    assert poles == kwargs.get("num_poles", 3)
    upright = [0.0] * poles
    for cart, angles, reward in [
        (0.24, upright, 1.0),
        (0.26, upright, 0.0),
        (0.0, [0.09, *upright[1:]], 1.0),
        (0.0, [0.11, *upright[1:]], 0.0),
        (0.0, [*upright[1:], -0.11], 0.0),
    ]:
        set_state(env.physics, cart, angles)
        assert env.task.get_reward(env.physics) == reward
        assert env.task.is_success(env.task.reward_terms(env.physics)) == bool(reward)


@pytest.mark.parametrize("task", list(cartpole.SUITE))
def test_a_start_is_nearly_still_and_upright_or_hanging(task: str) -> None:
    env = suite.load("cartpole", task, {"random": 0})
    hangs = "balance" not in task
    for _ in range(100):
        env.reset()
        position = env.physics.position()
        assert abs(position[0]) < 0.1
        assert abs(position[1] - (np.pi if hangs else 0.0)) < 0.06
        assert (abs(position[2:]) < 0.6).all()
        assert 0.0 < abs(env.physics.velocity()).max() < 0.06


def test_the_observation_is_the_cart_then_each_pole_in_the_world() -> None:
    env = suite.load("cartpole", "two_poles")
    set_state(env.physics, 0.3, [0.2, -0.9], velocity=2.0)
    obs = env.task.get_observation(env.physics)
    expected = [0.3, np.cos(0.2), np.sin(0.2), np.cos(-0.7), np.sin(-0.7)]
    np.testing.assert_allclose(obs["position"], expected, rtol=1e-12)
    np.testing.assert_array_equal(obs["velocity"], [0.0, 2.0, 2.0])


@pytest.mark.parametrize("poles", [1, 2, 3, 7])
def test_poles_hang_above_the_floor_and_each_begins_at_the_end_of_the_last(poles: int) -> None:
    physics = cartpole.Physics.from_xml_string(*cartpole.get_model_and_assets(poles))
    set_state(physics, 0.0, [np.pi] + [0.0] * (poles - 1))
    heights = physics.data.xpos[2:, 2]
    np.testing.assert_allclose(heights, 1.0 - np.arange(poles), atol=1e-12)
    assert heights[-1] - 1 == pytest.approx(physics.named.data.geom_xpos["floor", "z"] + 0.05)
