"""Tests of limberjack.suite.point_mass."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import point_mass

_TASKS = ["easy", "hard"]
_RADIUS = 0.015  # metres, of the target


def set_position(physics: Any, x: float, y: float) -> None:
    """Puts the ball somewhere, at rest."""
    with physics.reset_context():
        physics.data.qpos[:] = x, y


def accelerations(env: Any) -> np.ndarray:
    """Directions in which the two controls push the ball, (2, 2)."""
    found = []
    for control in ([1.0, 0.0], [0.0, 1.0]):
        set_position(env.physics, 0.0, 0.0)
        env.physics.set_control(control)
        env.physics.forward()
        found.append(env.physics.data.qacc / np.linalg.norm(env.physics.data.qacc))
    return np.array(found)


@pytest.mark.parametrize("task", _TASKS)
def test_closeness_to_the_target_is_rewarded(task: str) -> None:
    env = suite.load("point_mass", task)
    terms = {}
    for radii in (0.0, 0.9, 1.5, 2.0, 10.0):
        set_position(env.physics, -0.6 * radii * _RADIUS, 0.8 * radii * _RADIUS)
        distance = radii * _RADIUS
        vector = [0.6 * distance, -0.8 * distance, 0.0]
        np.testing.assert_allclose(env.physics.mass_to_target(), vector, atol=1e-15)
        assert env.physics.mass_to_target_dist() == pytest.approx(distance)
        terms[radii] = env.task.reward_terms(env.physics)["near_target"]
        assert env.task.get_reward(env.physics) == terms[radii]  # there is no effort
    assert terms[0.0] == terms[0.9] == 1.0
    assert terms[2.0] == pytest.approx(0.1)
    assert 0.1 < terms[1.5] < 1.0
    assert terms[10.0] < 1e-9


def test_effort_costs_at_most_a_fifth() -> None:
    env = suite.load("point_mass", "easy")
    set_position(env.physics, 0.0, 0.0)
    for control, expected in (([0, 0], 1.0), ([1, 0], 0.9), ([0.5, -0.5], 0.95), ([-1, 1], 0.8)):
        env.physics.set_control(control)
        assert env.task.get_reward(env.physics) == pytest.approx(expected)


def test_the_controls_of_easy_push_along_x_and_y() -> None:
    env = suite.load("point_mass", "easy", {"random": 0})
    for _ in range(3):
        env.reset()
        np.testing.assert_array_equal(accelerations(env), np.eye(2))


def test_the_controls_of_hard_push_along_random_directions_that_are_not_parallel() -> None:
    env = suite.load("point_mass", "hard", {"random": 0})
    cosines, firsts = [], []
    for _ in range(300):
        env.reset()
        drawn = env.physics.model.wrap_prm.reshape(2, 2)
        np.testing.assert_allclose(np.linalg.norm(drawn, axis=1), 1.0)
        np.testing.assert_allclose(accelerations(env), drawn, atol=1e-12)
        cosines.append(abs(drawn[0] @ drawn[1]))
        firsts.append(np.arctan2(*drawn[0]))
    assert 0.8 < max(cosines) <= 0.9
    quarters, _ = np.histogram(firsts, 4, range=(-np.pi, np.pi))
    assert quarters.min() > 43  # of 75 expected; four standard deviations are 30


def test_each_row_of_a_batch_has_its_own_directions() -> None:
    assert suite.load("point_mass", "easy").task.EPISODE_FIELDS == ()
    batch = suite.load_batch("point_mass", "hard", 3, seed=0)
    batch.reset()
    directions = [tuple(row) for row in batch.physics.model.wrap_prm]
    assert len(set(directions)) == 3
    batch.reset([1])
    after = [tuple(row) for row in batch.physics.model.wrap_prm]
    assert [a == b for a, b in zip(after, directions, strict=True)] == [True, False, True]


@pytest.mark.parametrize("task", _TASKS)
def test_a_start_is_anywhere_on_the_table_at_rest(task: str) -> None:
    env = suite.load("point_mass", task, {"random": 0})
    positions = []
    for _ in range(400):
        observation = env.reset().observation
        assert not observation["velocity"].any()
        positions.append(observation["position"])
    for axis in np.transpose(positions):
        quarters, _ = np.histogram(axis, 4, range=(-0.29, 0.29))
        assert quarters.sum() == 400
        assert quarters.min() > 60  # of 100 expected; four standard deviations are 35


def test_the_model_is_given_with_the_files_it_includes() -> None:
    physics = point_mass.Physics.from_xml_string(*point_mass.get_model_and_assets())
    assert physics.model.name == "planar point mass"
    assert (physics.model.nq, physics.model.ntendon, physics.model.nu) == (2, 2, 2)
