"""Tests of limberjack.suite.humanoid."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import humanoid
from limberjack.utils import rewards


@pytest.fixture(params=range(3))
def physics(request: pytest.FixtureRequest) -> Any:
    """Thrown about."""
    env = suite.load("humanoid", "run", {"random": request.param})
    env.reset()
    stream = np.random.RandomState(request.param)
    for _ in range(10):
        env.step(stream.uniform(-1, 1, 21))
    return env.physics


def set_pose(physics: Any, height: float) -> None:
    """Stands upright, every joint at zero, the torso at a height."""
    with physics.reset_context():
        physics.data.qpos[:] = 0.0
        physics.data.qpos[2:4] = height, 1.0


def test_limbs_are_seen_from_the_torso(physics: Any) -> None:
    data, model = physics.data, physics.model
    torso = model.name2id("torso", "body")
    frame = data.xmat[torso].reshape(3, 3)
    seen = []
    for side in ("left", "right"):
        for limb in ("hand", "foot"):
            body = model.name2id(f"{side}_{limb}", "body")
            seen.append((data.xpos[body] - data.xpos[torso]).dot(frame))
    np.testing.assert_array_equal(physics.extremities(), np.hstack(seen))
    np.testing.assert_array_equal(physics.torso_vertical_orientation(), frame[2])
    assert physics.torso_upright() == frame[2, 2]
    assert physics.head_height() == data.xpos[model.name2id("head", "body"), 2]
    np.testing.assert_array_equal(physics.joint_angles(), data.qpos[7:])


def test_the_centre_of_mass_is_that_of_all_bodies(physics: Any) -> None:
    masses = physics.model.body_mass
    centre = masses @ physics.data.xipos / masses.sum()
    # Summed in another order.
    np.testing.assert_allclose(physics.center_of_mass_position(), centre, atol=1e-12)
    before = physics.center_of_mass_position()
    physics.data.qvel[:] = 0.0
    physics.data.qvel[:3] = [0.3, -0.4, 0.5]
    physics.forward()
    np.testing.assert_allclose(physics.center_of_mass_velocity(), [0.3, -0.4, 0.5], atol=1e-12)
    np.testing.assert_array_equal(physics.center_of_mass_position(), before)


def test_turned_about_the_vertical_the_limbs_are_where_they_were(physics: Any) -> None:
    before = physics.extremities()
    w, x, y, z = physics.data.qpos[3:7]
    half = np.sqrt(0.5)
    physics.data.qpos[3:7] = half * np.array([w - z, x - y, y + x, z + w])
    physics.data.qpos[:2] += 3.0
    physics.forward()
    # Rounded in another place of the world.
    np.testing.assert_allclose(physics.extremities(), before, atol=1e-12)


@pytest.mark.parametrize("task", ["stand", "walk", "run", "run_pure_state"])
def test_standing_upright_and_still_is_fully_rewarded_by_stand(task: str) -> None:
    env = suite.load("humanoid", task)
    set_pose(env.physics, 1.3)
    terms = env.task.reward_terms(env.physics)
    assert terms["standing"] == terms["upright"] == terms["small_control"] == 1.0
    expected = 1.0 if task == "stand" else 1 / 6
    assert terms["movement"] == pytest.approx(expected)
    assert env.task.get_reward(env.physics) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("task", "speed", "movement"),
    [
        ("walk", 1.0, 1.0),
        ("walk", 3.0, 1.0),
        ("walk", 0.5, (5 * 0.5 + 1) / 6),
        ("run", 10.0, 1.0),
        ("run", 1.0, (5 * 0.1 + 1) / 6),
        ("run_pure_state", 5.0, (5 * 0.5 + 1) / 6),
        ("stand", 2.0, None),
    ],
)
def test_moving_is_rewarded_by_horizontal_speed_in_any_direction(
    task: str, speed: float, movement: float | None
) -> None:
    env = suite.load("humanoid", task)
    set_pose(env.physics, 1.3)
    for direction in ([1, 0], [0, -1], [0.6, 0.8]):
        velocity = speed * np.array(direction)
        env.physics.data.qvel[:3] = [*velocity, 7.0]  # the vertical does not count
        env.physics.forward()
        term = env.task.reward_terms(env.physics)["movement"]
        if movement is None:  # each axis by itself
            movement_now = rewards.tolerance(velocity, margin=2).mean()
        else:
            movement_now = movement
        assert term == pytest.approx(movement_now)


def test_effort_costs_at_most_a_fifth() -> None:
    env = suite.load("humanoid", "stand")
    set_pose(env.physics, 1.3)
    for effort, expected in ((0.0, 1.0), (0.5, 0.95), (1.0, 0.8), (-1.0, 0.8)):
        env.physics.set_control(np.full(21, effort))
        assert env.task.reward_terms(env.physics)["small_control"] == pytest.approx(expected)


def test_lying_and_leaning_are_rewarded_less() -> None:
    env = suite.load("humanoid", "stand")
    heights = [env.task.reward_terms(env.physics)["standing"]]
    for height in (1.3, 1.0, 0.7, 0.3):
        set_pose(env.physics, height)
        heights.append(env.task.reward_terms(env.physics)["standing"])
    assert heights[1:] == sorted(heights[1:], reverse=True)
    assert heights[1] == 1.0
    assert heights[-1] < 1e-3
    set_pose(env.physics, 1.3)
    for angle, expected in ((0.0, 1.0), (np.pi / 2, 1 - 0.9 / 1.9), (np.pi, 0.0)):
        env.physics.data.qpos[3:7] = np.cos(angle / 2), np.sin(angle / 2), 0, 0
        env.physics.forward()
        upright = env.task.reward_terms(env.physics)["upright"]
        assert upright == pytest.approx(expected, abs=1e-9)


def test_a_start_is_a_random_pose_at_rest() -> None:
    env = suite.load("humanoid", "walk", {"random": 0})
    tilts = []
    for _ in range(200):
        env.reset()
        assert not env.physics.velocity().any()
        assert env.physics.data.ncon == 0
        np.testing.assert_array_equal(env.physics.position()[:3], env.physics.model.qpos0[:3])
        assert np.linalg.norm(env.physics.position()[3:7]) == pytest.approx(1.0)
        tilts.append(env.physics.torso_upright())
    assert min(tilts) < -0.5
    assert max(tilts) > 0.5


def test_the_model_is_given_with_the_files_it_includes() -> None:
    xml, assets = humanoid.get_model_and_assets()
    physics = humanoid.Physics.from_xml_string(xml, assets)
    assert physics.model.name == "humanoid"
    assert (physics.model.nq, physics.model.nv, physics.model.nu) == (28, 27, 21)


def test_a_task_with_another_speed() -> None:
    env = suite.load("humanoid", "walk")
    task = humanoid.Humanoid(move_speed=4, pure_state=True, random=0)
    set_pose(env.physics, 1.3)
    env.physics.data.qvel[0] = 2.0
    env.physics.forward()
    assert task.reward_terms(env.physics)["movement"] == pytest.approx((5 * 0.5 + 1) / 6)
    assert list(task.get_observation(env.physics)) == ["position", "velocity"]
