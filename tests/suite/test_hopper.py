"""Tests of limberjack.suite.hopper."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import hopper


def set_pose(physics: Any, knee: float = 0.1, up: float = 1.0, speed: float = 0.0) -> None:
    """In the air with a bent knee, moving forward."""
    with physics.reset_context():
        physics.named.data.qpos["rootz"] = up
        physics.named.data.qpos["knee"] = knee
        physics.named.data.qvel["rootx"] = speed


@pytest.mark.parametrize(
    ("speed", "reward"),
    [(2.0, 1.0), (5.0, 1.0), (1.5, 0.75), (1.0, 0.5), (0.0, 0.0), (-2.0, 0.0)],
)
def test_hopping_is_rewarded_by_forward_speed(speed: float, reward: float) -> None:
    env = suite.load("hopper", "hop")
    set_pose(env.physics, speed=speed)
    assert env.physics.speed() == pytest.approx(speed)
    assert env.task.get_reward(env.physics) == pytest.approx(reward, abs=1e-9)


@pytest.mark.parametrize(("effort", "reward"), [(0.0, 1.0), (0.5, 0.95), (-1.0, 0.8)])
def test_standing_is_rewarded_less_with_effort(effort: float, reward: float) -> None:
    env = suite.load("hopper", "stand")
    set_pose(env.physics, speed=3.0)
    env.physics.set_control(np.full(4, effort))
    assert env.task.get_reward(env.physics) == pytest.approx(reward)


@pytest.mark.parametrize("task", ["stand", "hop"])
def test_without_height_above_the_foot_there_is_no_reward(task: str) -> None:
    env = suite.load("hopper", task)
    heights = []
    for knee in np.linspace(0.1, 2.6, 20):
        set_pose(env.physics, knee, up=5.0, speed=4.0)  # only the height above the foot counts
        heights.append(env.physics.height())
        is_high = heights[-1] >= 0.6
        assert env.task.reward_terms(env.physics)["standing"] == is_high
        assert (env.task.get_reward(env.physics) > 0) == is_high
    assert min(heights) < 0.6 < max(heights) < 1.5


def test_each_task_has_its_own_second_term() -> None:
    for task, second, goal in (
        ("stand", "small_control", ("standing",)),
        ("hop", "hopping", ("standing", "hopping")),
    ):
        env = suite.load("hopper", task)
        assert list(env.task.reward_terms(env.physics)) == ["standing", second]
        assert goal == env.task.GOAL


def test_toe_and_heel_feel_the_floor_in_this_order() -> None:
    physics = hopper.Physics.from_xml_string(*hopper.get_model_and_assets())
    set_pose(physics)
    np.testing.assert_array_equal(physics.touch(), [0.0, 0.0])
    for ankle, foot in ((0.5, 0), (-0.5, 1)):
        set_pose(physics, up=0.1)
        physics.named.data.qpos["ankle"] = ankle
        physics.forward()
        lowest = physics.named.data.site_xpos[["touch_toe", "touch_heel"], "z"].min()
        physics.named.data.qpos["rootz"] -= lowest - 0.03
        physics.step(5)
        touch = physics.touch()
        assert touch[foot] > 1.0
        assert touch[1 - foot] == 0.0
        force = physics.named.data.sensordata[["touch_toe", "touch_heel"]]
        np.testing.assert_allclose(np.exp(touch) - 1, force)


def test_a_start_is_a_random_pose_at_rest_that_is_observed_without_x() -> None:
    env = suite.load("hopper", "hop", {"random": 0})
    seen = []
    for _ in range(50):
        observation = env.reset().observation
        assert not observation["velocity"].any()
        np.testing.assert_array_equal(observation["position"], env.physics.data.qpos[1:])
        seen.append(observation["position"])
    low, high = np.min(seen, axis=0), np.max(seen, axis=0)
    assert low[0] == high[0] == 0.0
    assert low[1] < -2.5
    assert high[1] > 2.5
    assert np.all(high[2:] - low[2:] > 0.8 * np.ptp(env.physics.model.jnt_range[3:], axis=1))
