"""Poses of the hand around an object, and paths to them."""

import numpy as np
import pytest

from limberjack.planner.arm.collision import clearance
from limberjack.planner.arm.hand import ARM, PLANE, TIP_ASIDE, TIP_REACH
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.arm.roadmap import find_path
from limberjack.planner.manipulator.approach import TOUCHING, Approach, few_of
from limberjack.planner.manipulator.props import HAND, Ball, pose_of, prop_of
from limberjack.planner.manipulator.receptacles import Receptacle

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]
# The peg leans on the slot, so that neither its middle nor its handle can be reached from outside.
_LEANING = 1047, [2.51, -1.14, 1.62, -0.73], [-0.271, 0.111, 0.331]  # on the slot, handle up
_UNDER = 1070, [2.76, -1.48, 0.56, 1.95], [0.047, 0.032, 4.95]  # the slot, which the arm is behind
_ON_ARM = 1056, [2.72, -1.57, 0.34, 2.17], [-0.177, 0.336, -0.90]


def test_poses_around_an_object_are_clear_of_the_walls() -> None:
    _, physics = scene("insert_ball", 1003, _ARM, [0.0, 0.3, 0.0])
    data, cup = physics.named.data, Receptacle.for_object("ball")
    place, frame = pose_of(data, "target_ball")
    approach = Approach(Ball(["ball_x", "ball_z", "ball_y"]))
    beside = [(place + np.array([0.06, 0.0, 0.0]), frame)]
    now, random = data.qpos[ARM], np.random.default_rng(0)
    (anyhow,) = approach.poses_around(beside, now, random, 40)
    approach.set_walls(cup.walls(physics))
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
        slack = 1.5 * prop.slack
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


def test_an_arm_that_rakes_is_led_there_even_straight() -> None:
    cost, physics = scene("insert_peg", *_LEANING)
    for _ in range(6):
        cost.update(physics)
    goal, spot = cost._fetch.rake.goal, cost._fetch.rake.spot
    assert goal is not None
    end = cost._fetch.path.next_points(1)[-1]
    tips = [hand_places(end, TIP_REACH, aside) for aside in (TIP_ASIDE, -TIP_ASIDE)]
    start = spot._start(physics.named.data, goal)[PLANE]
    assert min(np.hypot(*(tip - start)) for tip in tips) < 0.07


def test_a_path_through_the_slot_is_not_taken() -> None:
    cost, physics = scene("insert_peg", *_UNDER)
    for _ in range(3):
        cost.update(physics)
    poses = np.array(cost._fetch.path.next_points(1))
    assert (clearance(poses, HAND, cost._fetch.approach.walls)[:, 0] > -0.005).all()


def test_the_arm_stretches_under_a_peg_that_lies_on_it() -> None:
    cost, physics = scene("insert_peg", *_ON_ARM)
    for _ in range(40):
        cost.update(physics)
    end = cost._fetch.path.next_points(1)[-1]
    assert np.abs(end[1:]).max() < 0.6 < np.abs(physics.named.data.qpos[ARM][1:]).max()


def test_an_arm_in_a_corner_finds_a_path_out_of_it() -> None:
    _, physics = scene("insert_peg", 1051, [-2.71, -1.5, -0.02, 0.38], [-0.406, 0.032, -1.33])
    walls = Receptacle.for_object("peg").walls(physics)
    goal = np.array([[1.93, 0.69, -0.43, 1.02]])  # on the other side of the slot
    assert find_path(physics.named.data.qpos[ARM], goal, HAND, walls, close=True) is not None
