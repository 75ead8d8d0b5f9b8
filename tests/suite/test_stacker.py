"""Tests of limberjack.suite.stacker."""

import collections
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.suite import stacker

_OFF_PLANE = 0.001  # metres; the target is drawn in front of the plane
every_task = pytest.mark.parametrize("n_boxes", [2, 4])


def load(n_boxes: int, seed: int = 0) -> Any:
    return suite.load("stacker", f"stack_{n_boxes}", {"random": seed})


@every_task
def test_the_target_is_at_each_level_about_as_often(n_boxes: int) -> None:
    env = load(n_boxes)
    episodes = 200 * n_boxes
    counts: collections.Counter = collections.Counter()
    for _ in range(episodes):
        env.reset()
        level = env.task.start(env.physics)
        counts[level] += 1
        half_size = env.physics.named.model.geom_size["target", "x"]
        x, z = env.physics.named.model.body_pos["target", ["x", "z"]]
        assert -0.37 <= x <= 0.37
        assert z == half_size * (2 * int(level.removeprefix("level_")) + 1)
    assert set(counts) == {f"level_{i}" for i in range(n_boxes)}
    # Within five standard deviations of 200; the target touches nothing, so none is rejected.
    assert all(abs(count - 200) < 70 for count in counts.values()), counts


@every_task
def test_boxes_start_anywhere_above_the_floor_at_rest(n_boxes: int) -> None:
    env = load(n_boxes)
    for _ in range(30):
        env.reset()
        qpos = env.physics.named.data.qpos
        for i in range(n_boxes):
            x, z, y = qpos[[f"box{i}_x", f"box{i}_z", f"box{i}_y"]]
            assert 0.1 <= x <= 0.3
            assert 0.0 <= z <= 0.7
            assert 0.0 <= y <= 2 * np.pi
        assert not env.physics.velocity().any()


@every_task
def test_poses_and_velocities_of_the_boxes_are_in_their_order(n_boxes: int) -> None:
    env = load(n_boxes)
    env.reset()
    env.physics.data.qvel[:] = np.arange(env.physics.model.nv)
    seen = env.task.get_observation(env.physics)
    for i in range(n_boxes):
        np.testing.assert_array_equal(seen["box_pos"][i], env.physics.body_2d_pose(f"box{i}"))
        joints = [f"box{i}_{dimension}" for dimension in "xyz"]
        velocity = env.physics.named.data.qvel[joints]
        np.testing.assert_array_equal(seen["box_vel"][3 * i : 3 * i + 3], velocity)
    target = env.physics.named.model.body_pos["target", ["x", "z"]]
    np.testing.assert_array_equal(seen["target_pos"], target)


@every_task
def test_any_box_at_the_target_counts_once_the_hand_is_away(n_boxes: int) -> None:
    env = load(n_boxes)
    env.reset()
    physics, model = env.physics, env.physics.named.model
    qpos = physics.named.data.qpos
    target = model.body_pos["target", ["x", "z"]]
    size = 2 * model.geom_size["target", "x"]
    boxes = [[f"box{i}_x", f"box{i}_z"] for i in range(n_boxes)]
    for nearest in boxes:
        for box in boxes:
            qpos[box] = target + np.array([5.0, 0.0])
        for distance in (0.0, size, 3 * size):
            qpos[nearest] = target + np.array([distance, 0.0])
            physics.forward()
            expected = 0.1 ** ((np.hypot(distance, _OFF_PLANE) / size) ** 2)
            close = env.task.reward_terms(physics)["box_is_close"]
            assert close == pytest.approx(expected, abs=1e-9)
    grasp = physics.named.data.site_xpos["grasp", ["x", "z"]].copy()
    for distance in (0.2, 0.1, 0.095, 0.09, 0.0):
        model.body_pos["target", ["x", "z"]] = grasp + np.array([distance, 0.0])
        qpos[boxes[-1]] = grasp + np.array([distance, 0.0])
        physics.forward()
        apart = np.hypot(distance, _OFF_PLANE)
        far = 1.0 if apart >= 0.1 else 0.1 ** (((0.1 - apart) / 0.01) ** 2)
        terms = env.task.reward_terms(physics)
        assert terms["hand_is_far"] == pytest.approx(far, abs=1e-9)
        assert env.task.get_reward(physics) == terms["box_is_close"] * terms["hand_is_far"]


@pytest.mark.parametrize("n_boxes", [1, 2, 3, 4])
def test_a_model_has_as_many_boxes_as_asked_for(n_boxes: int) -> None:
    xml, assets = stacker.make_model(n_boxes)
    physics = stacker.Physics.from_xml_string(xml, assets)
    names = physics.named.data.xpos.axes.row.names
    assert [name for name in names if name.startswith("box")] == [f"box{i}" for i in range(n_boxes)]
    assert "target" in names


def test_a_stack_of_another_height_can_be_made() -> None:
    physics = stacker.Physics.from_xml_string(*stacker.make_model(3))
    env = control.Environment(
        physics, stacker.Stack(3, fully_observable=True, random=0), control_timestep=0.01
    )
    assert env.reset().observation["box_pos"].shape == (3, 4)
    assert env.step(np.zeros(5)).mid()


def test_the_nearest_box_is_found_whichever_it_is() -> None:
    env = load(4)
    env.reset()
    physics = env.physics
    distances = [physics.site_distance(f"box{i}", "target") for i in range(4)]
    size = 2 * physics.named.model.geom_size["target", "x"]
    expected = 0.1 ** ((min(distances) / size) ** 2)
    assert env.task.reward_terms(physics)["box_is_close"] == pytest.approx(expected)
