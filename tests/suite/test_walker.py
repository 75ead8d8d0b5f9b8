"""Tests of limberjack.suite.walker."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import walker


def set_pose(physics: Any, height: float = 1.3, tilt: float = 0.0, speed: float = 0.0) -> None:
    """Stretched legs, the torso at a height and turned, moving forward."""
    with physics.reset_context():
        physics.named.data.qpos["rootz"] = height - 1.3
        physics.named.data.qpos["rooty"] = tilt
        physics.named.data.qvel["rootx"] = speed


@pytest.mark.parametrize(
    ("task", "speed", "reward"),
    [
        ("stand", 0.0, 1.0),
        ("stand", 5.0, 1.0),
        ("walk", 1.0, 1.0),
        ("walk", 3.0, 1.0),
        ("walk", 0.75, (5 * 0.75 + 1) / 6),
        ("walk", 0.5, (5 * 0.5 + 1) / 6),
        ("walk", 0.0, 1 / 6),
        ("walk", -1.0, 1 / 6),
        ("run", 8.0, 1.0),
        ("run", 4.0, (5 * 0.5 + 1) / 6),
        ("run", 1.0, (5 * 0.125 + 1) / 6),
    ],
)
def test_an_upright_body_is_rewarded_by_its_forward_speed(
    task: str, speed: float, reward: float
) -> None:
    env = suite.load("walker", task)
    set_pose(env.physics, speed=speed)
    assert env.physics.horizontal_velocity() == pytest.approx(speed)
    assert env.task.get_reward(env.physics) == pytest.approx(reward)


def test_only_a_task_that_moves_has_movement_as_a_goal() -> None:
    env = suite.load("walker", "stand")
    assert list(env.task.reward_terms(env.physics)) == list(env.task.GOAL)
    assert env.task.GOAL == ("standing", "upright")
    assert suite.load("walker", "walk").task.GOAL == ("standing", "upright", "movement")


@pytest.mark.parametrize(
    ("height", "tilt", "standing", "upright"),
    [(1.2, 0.0, 1.0, 1.0), (0.6, 0.0, 0.1, 1.0), (1.3, np.pi / 2, 1.0, 0.5), (1.3, np.pi, 1, 0)],
)
def test_standing_counts_three_times_as_much_as_being_upright(
    height: float, tilt: float, standing: float, upright: float
) -> None:
    env = suite.load("walker", "stand")
    set_pose(env.physics, height + 1e-9, tilt)
    assert env.physics.torso_height() == pytest.approx(height)
    terms = env.task.reward_terms(env.physics)
    assert terms == pytest.approx({"standing": standing, "upright": upright})
    assert env.task.get_reward(env.physics) == pytest.approx((3 * standing + upright) / 4)


def test_orientations_are_cosine_and_sine_of_the_angles_of_all_bodies() -> None:
    env = suite.load("walker", "walk")
    with env.physics.reset_context():
        env.physics.named.data.qpos["rooty"] = 0.3
        env.physics.named.data.qpos["right_hip"] = 0.5
        env.physics.named.data.qpos["left_knee"] = -1.0
    # The legs' hinges turn against the root's.
    angles = np.array([0.3, -0.2, -0.2, -0.2, 0.3, 1.3, 1.3])
    pairs = env.physics.orientations().reshape(7, 2)
    np.testing.assert_allclose(pairs, np.c_[np.cos(angles), np.sin(angles)], atol=1e-12)


def test_a_start_is_a_random_pose_at_rest_in_the_same_place() -> None:
    env = suite.load("walker", "run", {"random": 0})
    tilts = []
    for _ in range(100):
        env.reset()
        assert not env.physics.velocity().any()
        np.testing.assert_array_equal(env.physics.position()[:2], 0.0)
        tilts.append(env.physics.torso_upright())
    assert min(tilts) < -0.9
    assert max(tilts) > 0.9


def test_a_task_with_another_speed() -> None:
    physics = walker.Physics.from_xml_string(*walker.get_model_and_assets())
    task = walker.PlanarWalker(move_speed=4, random=0)
    set_pose(physics, speed=3.0)
    assert task.reward_terms(physics)["movement"] == pytest.approx(0.75)
