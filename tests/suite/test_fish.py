"""Tests of limberjack.suite.fish."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite


def set_pose(physics: Any, tilt: float = 0.0, turn: float = 0.0) -> None:
    """Tilted about the long axis y, then turned about the vertical."""
    with physics.reset_context():
        c, s = np.cos(turn / 2), np.sin(turn / 2)
        cos, sin = np.cos(tilt / 2), np.sin(tilt / 2)
        physics.data.qpos[3:7] = c * cos, -s * sin, c * sin, s * cos


def put_target(physics: Any, from_mouth: list[float]) -> None:
    """Puts the target beside the mouth, in the axes of the world."""
    position = physics.named.data.geom_xpos["mouth"] + from_mouth
    physics.named.model.geom_pos["target"] = position
    physics.forward()


@pytest.mark.parametrize("tilt", [0.0, 0.5, np.pi / 2, 3.0])
def test_being_upright_is_rewarded_by_both_tasks(tilt: float) -> None:
    env = suite.load("fish", "upright")
    set_pose(env.physics, tilt, turn=1.0)
    cosine = np.cos(tilt)
    assert env.physics.upright() == pytest.approx(cosine)
    # A gaussian that is 0.1 on the side.
    assert env.task.get_reward(env.physics) == pytest.approx(0.1 ** ((1 - cosine) ** 2))
    env = suite.load("fish", "swim")
    set_pose(env.physics, tilt)
    put_target(env.physics, [3.0, 0.0, 0.0])
    assert env.task.get_reward(env.physics) == pytest.approx((1 + cosine) / 2 / 8)


@pytest.mark.parametrize(
    ("distance", "in_target"), [(0.0, 1.0), (0.044, 1.0), (0.045 + 0.09, 0.1), (0.5, 0.0)]
)
def test_the_mouth_in_the_target_is_seven_eighths_of_the_reward(
    distance: float, in_target: float
) -> None:
    env = suite.load("fish", "swim")
    set_pose(env.physics)
    put_target(env.physics, [0.0, 0.6 * distance, 0.8 * distance])
    terms = env.task.reward_terms(env.physics)
    assert terms["in_target"] == pytest.approx(in_target, abs=1e-9)
    assert env.task.get_reward(env.physics) == pytest.approx((7 * in_target + 1) / 8)
    assert env.task.is_success(terms) == (in_target > 0.9)


def test_a_larger_target_is_reached_from_farther_away_in_its_row_of_a_batch() -> None:
    randomize = {"geom_size": lambda random, nominal: nominal * (1 + 9 * (random.rand() > 0.5))}
    batch = suite.load_batch("fish", "swim", 8, seed=0, environment_kwargs={"randomize": randomize})
    batch.reset()
    physics = batch.physics
    radii = physics.named.model.geom_size[["mouth", "target"], 0].sum(axis=-1)
    assert sorted(set(np.round(radii, 9))) == [0.045, 0.45]
    distance = np.linalg.norm(physics.mouth_to_target(), axis=-1)
    is_inside = distance <= radii
    assert set(is_inside) == {True, False}
    in_target = batch.task.reward_terms(physics)["in_target"]
    np.testing.assert_array_equal(in_target == 1.0, is_inside)


def test_the_target_is_seen_from_the_mouth() -> None:
    env = suite.load("fish", "swim")
    set_pose(env.physics)
    put_target(env.physics, [0.1, 0.2, 0.3])
    frame = env.physics.named.data.geom_xmat["mouth"].reshape(3, 3)
    seen = env.physics.mouth_to_target()
    np.testing.assert_allclose(frame @ seen, [0.1, 0.2, 0.3], atol=1e-12)
    set_pose(env.physics, turn=np.pi / 2)
    put_target(env.physics, [-0.2, 0.1, 0.3])  # turned with the fish
    np.testing.assert_allclose(env.physics.mouth_to_target(), seen, atol=1e-12)


@pytest.mark.parametrize("task", ["upright", "swim"])
def test_a_start_has_any_orientation_and_slightly_bent_joints_at_rest(task: str) -> None:
    env = suite.load("fish", task, {"random": 0})
    uprights, angles = [], []
    for _ in range(200):
        env.reset()
        assert not env.physics.velocity().any()
        assert np.linalg.norm(env.physics.data.qpos[3:7]) == pytest.approx(1.0)
        uprights.append(env.physics.upright())
        angles.append(env.physics.joint_angles())
    counts, _ = np.histogram(uprights, 4, (-1, 1))
    assert counts.min() > 30
    assert 0.19 < abs(np.array(angles)).max() <= 0.2


def test_only_swim_shows_its_target_and_puts_it_above_the_ground() -> None:
    env = suite.load("fish", "swim", {"random": 0})
    places = []
    for _ in range(200):
        env.reset()
        places.append(env.physics.named.data.geom_xpos["target"].copy())
    np.testing.assert_allclose(np.min(places, axis=0), [-0.4, -0.4, 0.1], atol=0.02)
    np.testing.assert_allclose(np.max(places, axis=0), [0.4, 0.4, 0.3], atol=0.02)
    assert env.physics.named.model.geom_rgba["target", "a"] > 0
    env = suite.load("fish", "upright")
    env.reset()
    assert env.physics.named.model.geom_rgba["target", "a"] == 0


def test_torso_velocity_is_linear_then_angular_in_the_frame_of_the_torso() -> None:
    env = suite.load("fish", "upright")
    set_pose(env.physics, turn=np.pi / 2)
    env.physics.data.qvel[:6] = 1.0, 2.0, 3.0, 0.1, 0.2, 0.3
    env.physics.forward()
    expected = [2.0, -1.0, 3.0, 0.1, 0.2, 0.3]
    np.testing.assert_allclose(env.physics.torso_velocity(), expected, atol=1e-12)
    env.physics.named.data.qvel["tail1"] = 4.0
    assert env.physics.joint_velocities()[0] == 4.0
