"""Tests of limberjack.suite.ball_in_cup."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import ball_in_cup

_MIDDLE = 0.55  # metres; height of the middle of the resting cup
_BALL = 0.2  # metres; height at which ball_z is 0


def put_ball(physics: Any, x: float, z: float, cup_x: float = 0.0) -> None:
    """Puts the ball at a displacement from the middle of the resting cup."""
    with physics.reset_context():
        physics.data.qpos[:] = cup_x, 0.0, x, _MIDDLE - _BALL + z


def test_the_vector_to_the_target_is_that_to_the_middle_of_the_cup() -> None:
    physics = suite.load("ball_in_cup", "catch").physics
    put_ball(physics, 0.1, -0.2, cup_x=0.05)
    np.testing.assert_allclose(physics.ball_to_target(), [-0.05, 0.2])


@pytest.mark.parametrize(
    ("x", "z", "reward"),
    [
        (0.0, 0.0, 1),
        (0.024, -0.024, 1),
        (-0.024, 0.024, 1),
        (0.026, 0.0, 0),
        (-0.026, 0.0, 0),
        (0.0, 0.026, 0),
        (0.0, -0.026, 0),
        (0.2, 0.1, 0),
    ],
)
def test_only_a_ball_that_is_wholly_in_the_cup_is_rewarded(x: float, z: float, reward: int) -> None:
    env = suite.load("ball_in_cup", "catch")
    put_ball(env.physics, x, z)
    for found in (env.physics.in_target(), env.task.get_reward(env.physics)):
        assert type(found) is float
        assert found == reward
    assert env.task.is_success(env.task.reward_terms(env.physics)) == bool(reward)


def test_each_row_of_a_batch_has_its_own_reward() -> None:
    batch = suite.load_batch("ball_in_cup", "catch", 3, seed=0)
    batch.reset()
    batch.physics.data.qpos[:] = [[0, 0, x, _MIDDLE - _BALL] for x in (0.0, 0.03, 0.02)]
    batch.physics.forward()
    rewards = batch.task.get_reward(batch.physics)
    assert rewards.dtype == float
    np.testing.assert_array_equal(rewards, [1, 0, 1])


def test_each_row_of_a_batch_has_its_own_size_of_ball() -> None:
    randomize = {"geom_size": lambda random, nominal: nominal * random.uniform(0.5, 1.5)}
    options = {"randomize": randomize}
    batch = suite.load_batch("ball_in_cup", "catch", 20, seed=0, environment_kwargs=options)
    batch.reset()
    batch.physics.data.qpos[:] = [0, 0, 0.02, _MIDDLE - _BALL]
    batch.physics.forward()
    radius = batch.physics.named.model.geom_size["ball", "x"]
    fits = 0.02 + radius < 0.05
    assert 0 < fits.sum() < 20
    np.testing.assert_array_equal(batch.physics.in_target(), fits)


def test_a_caught_ball_stays_in_the_cup() -> None:
    env = suite.load("ball_in_cup", "catch", {"random": 0})
    env.reset()
    put_ball(env.physics, 0.0, 0.0)
    assert [env.step([0.0, 0.0]).reward for _ in range(100)] == [1.0] * 100


def test_a_ball_that_is_not_caught_hangs_on_its_string() -> None:
    env = suite.load("ball_in_cup", "catch", {"random": 0})
    env.reset()
    put_ball(env.physics, 0.0, -0.2)
    for _ in range(999):
        env.step([0.0, 0.0])
    sites = env.physics.named.data.site_xpos
    # The string gives by a fraction of a millimetre.
    np.testing.assert_allclose(sites["cup"] - sites["ball"], [0, 0, 0.3], atol=1e-3)


def test_a_start_has_the_ball_anywhere_around_the_cup_without_contacts_at_rest() -> None:
    env = suite.load("ball_in_cup", "catch", {"random": 0})
    balls = []
    for _ in range(400):
        observation = env.reset().observation
        assert env.physics.data.ncon == 0
        assert not observation["velocity"].any()
        assert not observation["position"][:2].any()
        balls.append(observation["position"][2:])
    for values, (low, high) in zip(np.transpose(balls), ((-0.2, 0.2), (0.2, 0.5)), strict=True):
        ends, _ = np.histogram(values, 4, range=(low, high))
        assert ends.sum() == 400
        assert ends.min() > 50  # of 100 expected, and fewer around the cup


def test_the_model_is_given_with_the_files_it_includes() -> None:
    physics = ball_in_cup.Physics.from_xml_string(*ball_in_cup.get_model_and_assets())
    assert physics.model.name == "ball in cup"
    assert (physics.model.nq, physics.model.nv, physics.model.nu) == (4, 4, 2)
