"""Poses of the hand around an object, and paths to them."""

import numpy as np
import pytest

from limberjack.planner.arm.collision import clearance
from limberjack.planner.arm.hand import ARM
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.manipulator.approach import TOUCHING, Approach, few_of
from limberjack.planner.manipulator.props import HAND, Ball, pose_of, prop_of
from limberjack.planner.manipulator.receptacles import Receptacle

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]


def test_poses_around_an_object_are_clear_of_the_walls() -> None:
    _, physics = scene("insert_ball", 1003, _ARM, [0.0, 0.3, 0.0])
    data, cup = physics.named.data, Receptacle.for_object("ball")
    place, frame = pose_of(data, "target_ball")
    approach = Approach(Ball(["ball_x", "ball_z", "ball_y"]), spare=2)
    beside = [(place + np.array([0.06, 0.0, 0.0]), frame)]
    now, random = data.qpos[ARM], np.random.default_rng(0)
    (anyhow,) = approach.poses_around(beside, now, random, 40)
    approach.walls = cup.walls(physics)
    (clear,) = approach.poses_around(beside, now, random, 40)
    assert (clearance(anyhow, HAND, approach.walls)[:, 0] <= TOUCHING).any()
    assert len(clear) <= 40
    assert (clearance(clear, HAND, approach.walls)[:, 0] > TOUCHING).all()


@pytest.mark.parametrize("task", ["bring_ball", "bring_peg"])
def test_poses_around_a_prop_have_it_ahead_of_the_hand(task: str) -> None:
    cost, physics = scene(task, 1000, _ARM, [0.0, 0.3, 0.0])
    prop, data = prop_of(cost.task), physics.named.data
    data.qpos[prop.joints] = 0.1, 0.1, 0.0
    physics.forward()
    poses = [pose_of(data, prop.name)]
    random = np.random.default_rng(0)
    (found,) = Approach(prop).poses_around(poses, data.qpos[ARM], random, 6, 0.06, 0.5)
    assert 0 < len(found) <= 6
    for pose in found:
        data.qpos[ARM] = pose
        physics.forward()
        ahead, aside = prop.offset(data)
        slack = 1.5 * prop.grip.slack
        assert 0.06 - 0.006 <= ahead <= 0.06 + slack + 0.006
        assert abs(aside) < 0.006


@pytest.mark.parametrize(("speed", "height"), [(0.0, None), (2.0, 0.04)])
def test_a_path_leads_before_the_ball_or_to_where_a_rolling_one_is_awaited(
    speed: float, height: float | None
) -> None:
    cost, physics = scene("insert_ball", 1003, _ARM, [0.1, 0.022, 0.0])
    physics.named.data.qvel["ball_x"] = speed
    goals = cost._fetch.approach._around_ball(physics.named.data)
    assert len(goals)
    hands = hand_places(goals, GRASP + 0.06)
    if height is not None:
        # The arm's Jacobian is followed in a few steps.
        np.testing.assert_allclose(hands[:, 1], height, atol=2e-3)
        assert np.ptp(hands[:, 0]) > 0.2
        return
    assert np.abs(hands - [0.1, 0.022]).max() < 0.03


def test_another_attempt_has_twelve_of_the_poses_or_all_of_fewer() -> None:
    poses = np.arange(80.0).reshape(20, 4)
    for given, count in ((poses, 12), (poses[:5], 5)):
        few = few_of(np.random.default_rng(0), given)
        assert len({tuple(pose) for pose in few}) == count
        assert np.isin(few[:, 0], given[:, 0]).all()
