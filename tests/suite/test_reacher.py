"""Tests of limberjack.suite.reacher."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.suite import reacher

_RADII = {"easy": 0.05, "hard": 0.015}  # metres
_FINGER = 0.01  # metres; radius


def put_target(physics: Any, distance: float) -> None:
    """Puts the target at a distance from the finger of the stretched arm."""
    with physics.reset_context():
        physics.data.qpos[:] = 0.0
        physics.named.model.geom_pos["target", :2] = 0.24 - 0.6 * distance, 0.8 * distance


def test_the_vector_to_the_target_lies_in_the_plane() -> None:
    env = suite.load("reacher", "easy", {"random": 0})
    env.reset()
    put_target(env.physics, 0.1)
    env.physics.named.model.geom_pos["target", "z"] = 1.0  # the height does not count
    env.physics.forward()
    np.testing.assert_allclose(env.physics.finger_to_target(), [-0.06, 0.08])
    assert env.physics.finger_to_target_dist() == pytest.approx(0.1)
    to_target = env.task.get_observation(env.physics)["to_target"]
    np.testing.assert_array_equal(to_target, env.physics.finger_to_target())


@pytest.mark.parametrize("task", list(_RADII))
def test_only_a_finger_that_overlaps_the_target_is_rewarded(task: str) -> None:
    env = suite.load("reacher", task, {"random": 0})
    env.reset()
    touching = _RADII[task] + _FINGER
    for distance, reward in ((0.0, 1), (touching - 1e-6, 1), (touching + 1e-6, 0), (0.3, 0)):
        put_target(env.physics, distance)
        found = env.task.get_reward(env.physics)
        assert type(found) is float
        assert found == reward
        assert env.task.is_success(env.task.reward_terms(env.physics)) == bool(reward)


def test_each_row_of_a_batch_is_rewarded_by_the_size_of_its_own_target() -> None:
    batch = suite.load_batch("reacher", "easy", 3, seed=0)
    batch.reset()
    batch.physics.data.qpos[:] = 0.0
    batch.physics.named.model.geom_pos["target", ["x", "y"]] = 0.24, 0.05
    batch.physics.named.model.geom_size["target", "x"] = 0.05, 0.03, 0.041
    batch.physics.forward()
    np.testing.assert_array_equal(batch.task.get_reward(batch.physics), [1, 0, 1])


@pytest.mark.parametrize("task", list(_RADII))
def test_a_start_is_any_pose_at_rest_and_a_target_within_reach(task: str) -> None:
    env = suite.load("reacher", task, {"random": 0})
    poses, targets = [], []
    for _ in range(400):
        observation = env.reset().observation
        assert not observation["velocity"].any()
        assert env.physics.named.model.geom_size["target", "x"] == _RADII[task]
        poses.append(observation["position"])
        targets.append(env.physics.named.data.geom_xpos["target", :2].copy())
    distances = np.linalg.norm(targets, axis=1)
    angles = np.arctan2(*np.transpose(targets))
    shoulder, wrist = np.transpose(poses)
    for values, (low, high) in (
        (distances, (0.05, 0.2)),
        (angles, (-np.pi, np.pi)),
        (shoulder, (-np.pi, np.pi)),
        (wrist, np.deg2rad([-160, 160])),
    ):
        quarters, _ = np.histogram(values, 4, range=(low, high))
        assert quarters.sum() == 400
        assert quarters.min() > 60  # of 100 expected; four standard deviations are 35


def test_links_and_target_pass_through_each_other() -> None:
    env = suite.load("reacher", "easy", {"random": 0})
    env.reset()
    put_target(env.physics, 0.0)
    assert env.physics.data.ncon == 0


def test_a_task_with_another_target() -> None:
    physics = suite.load("reacher", "easy").physics
    env = control.Environment(physics, reacher.Reacher(target_size=0.1, random=0))
    env.reset()
    assert physics.named.model.geom_size["target", "x"] == 0.1
    put_target(physics, 0.109)
    assert env.task.get_reward(physics) == 1.0


def test_the_model_is_given_with_the_files_it_includes() -> None:
    physics = reacher.Physics.from_xml_string(*reacher.get_model_and_assets())
    assert physics.model.name == "two-link planar reacher"
    assert (physics.model.nq, physics.model.nv, physics.model.nu) == (2, 2, 2)
