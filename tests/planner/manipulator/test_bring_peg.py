"""The cost of bringing a peg that is hard to reach."""

import numpy as np

from limberjack.planner.arm.hand import ARM
from limberjack.planner.arm.kinematics import GRASP, hand_places

from .peg_scenes import peg_scene

_ON_ARM = [2.72, -1.57, 0.34, 2.17], [-0.177, 0.336, -0.90]  # arm (folded) and peg
_AGAINST_A_WALL = [0.0, 0.0, 0.0, 0.0], [-0.5, 0.15, 0.8]
_HARD_TARGET = 1134  # the seed: its target is low and beside the middle


def test_a_peg_that_does_not_move_is_raked_from_elsewhere_without_a_pause() -> None:
    cost, physics = peg_scene("bring_peg", 1000, *_AGAINST_A_WALL)
    spots = []
    for _ in range(150):
        cost.update(physics)
        spots.append(cost._spots.now)
        assert not cost._withdraws
    assert len(set(spots)) > 2
    assert cost._rake_to is not None


def test_the_arm_stretches_under_a_peg_that_lies_on_it() -> None:
    cost, physics = peg_scene("bring_peg", 1000, *_ON_ARM)
    now = physics.named.data.qpos[ARM]
    for _ in range(20):
        cost.update(physics)
    end = cost._paths.plans(now, 40)[-1][-1, :4]
    assert np.abs(end[1:]).max() < 0.6 < np.abs(now[1:]).max()


def test_a_peg_leans_at_a_target_where_the_hand_cannot_hold_it_straight() -> None:
    arm = [0.0, 0.7, 0.7, 0.7]
    held = [*hand_places(np.array(arm), GRASP), np.pi - sum(arm)]
    cost, physics = peg_scene("bring_peg", _HARD_TARGET, arm, held)
    data, random = physics.named.data, np.random.default_rng(0)
    assert len(cost._poses_at_target(data, random, 200)) == 0
    for _ in range(8):
        cost._find_path_to_target(physics)
    pose = cost._paths.plans(data.qpos[ARM], 40)[-1][-1, :4]
    data.qpos[ARM] = pose
    data.qpos[cost.task.object_joints] = [*hand_places(pose, GRASP), np.pi - pose.sum()]
    physics.forward()
    assert cost.task.get_reward(physics) > 0.99
