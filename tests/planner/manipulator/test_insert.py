"""The cost of inserting the ball and the peg."""

import numpy as np
import pytest

from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, PLANE
from limberjack.planner.arm.kinematics import GRASP, hand_places, hand_poses
from limberjack.planner.arm.proposals import plans_of
from limberjack.planner.manipulator.fetch import Stage
from limberjack.planner.manipulator.insert import _letting_fall, _pushing_in

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]
# The peg leans on the slot, so that neither its middle nor its handle can be reached from outside.
_LEANING = 1047, [2.51, -1.14, 1.62, -0.73], [-0.271, 0.111, 0.331]  # on the slot, handle up


@pytest.mark.parametrize("task", ["insert_ball", "insert_peg"])
def test_an_object_in_its_place_is_left_there_with_an_open_hand(task: str) -> None:
    cost, physics = scene(task, 1003, _ARM, [0.0, 0.3, 0.0])
    target = cost._receptacle.target
    quat, place = physics.named.model.body_quat[target], physics.named.data.xpos[target][PLANE]
    physics.named.data.qpos[cost.task.object_joints] = [*place, 2 * np.arctan2(quat[2], quat[0])]
    physics.forward()
    cost.update(physics)
    assert cost.stage()[0] is Stage.LEAVE
    found = cost.proposals(physics, np.random.default_rng(0))
    assert (found[..., 4] == OPEN_ANGLE).all()
    assert cost.noise_scale < 1.0


def test_a_ball_held_before_the_mouth_is_inserted_and_one_elsewhere_carried() -> None:
    cost, physics = scene("insert_ball", 1003, _ARM, [0.0, 0.3, 0.0])
    data, cup = physics.named.data, cost._receptacle
    axis = cup.axes(data)[0]
    mouth = data.site_xpos[cup.target][PLANE] + cup.before * axis
    angle = float(np.arctan2(axis[0], -axis[1]))
    facing = hand_poses(np.random.default_rng(0), mouth, GRASP, data.qpos[ARM], 1, angle, 0.5)[0]
    data.qpos[["thumb", "finger"]] = cost._fetch.prop.firm
    for pose, stage in ((np.array(_ARM), Stage.CARRY), (facing, Stage.INSERT)):
        cost.reset()
        data.qpos[ARM], data.qpos[["ball_x", "ball_z"]] = pose, hand_places(pose, GRASP)
        physics.forward()
        cost.update(physics)
        assert cost.stage()[0] is stage


def test_a_held_peg_is_carried_also_after_failed_searches_for_a_path_to_it() -> None:
    place = hand_places(np.array(_ARM), GRASP)
    cost, physics = scene("insert_peg", 1003, _ARM, [*place, np.pi - sum(_ARM)])
    cost.update(physics)
    assert cost.stage()[0] is not Stage.CARRY
    cost._fetch.rake.misses = 2
    physics.named.data.qpos[["thumb", "finger"]] = cost._fetch.prop.firm
    physics.forward()
    cost.update(physics)
    assert cost.stage()[0] is Stage.CARRY


def test_a_ball_behind_the_cup_is_approached_on_a_path_around_it() -> None:
    cost, physics = scene("insert_ball", 1003, _ARM, [0.0, 0.3, 0.0])
    data, cup = physics.named.data, cost._receptacle
    place = data.site_xpos[cup.target][PLANE]
    blocked = 0
    for x in np.linspace(-0.35, 0.35, 8):
        cost.reset()
        data.qpos[["ball_x", "ball_z"]] = x, 0.022
        physics.forward()
        cost.update(physics)
        path = cost._fetch.path
        assert path is None or not path.is_straight
        blocked += path is not None
        assert cost.stage()[0] is Stage.FETCH
    assert blocked, f"the cup at {place} is in no path"


def test_a_ball_that_does_not_fall_in_is_released_elsewhere() -> None:
    place = hand_places(np.array(_ARM), GRASP)
    cost, physics = scene("insert_ball", 1003, _ARM, [*place, 0.0])
    physics.named.data.qpos[["thumb", "finger"]] = cost._fetch.prop.firm
    physics.forward()
    cost.update(physics)
    cost._trials = 4
    cost.update(physics)
    assert cost._release.is_due


def test_proposals_open_the_hand_above_the_mouth() -> None:
    place = hand_places(np.array(_ARM), GRASP)
    cost, physics = scene("insert_ball", 1003, _ARM, [*place, 0.0])
    found = _letting_fall(cost._receptacle, physics.named.data, np.random.default_rng(0))
    assert len(found) > 4
    assert {proposal.grasp[-1] for proposal in found} == {OPEN_ANGLE, cost._fetch.prop.ready}


def test_a_peg_that_is_all_the_way_in_is_pushed_no_further() -> None:
    cost, physics = scene("insert_peg", *_LEANING)
    data, slot = physics.named.data, cost._receptacle
    axis, across = slot.axes(data)
    up, beside = slot.offset(data, slot.sites[0])
    # 2 mm deeper than it need be.
    data.qpos[cost.task.object_joints[:2]] -= (up + 0.002) * axis + beside * across
    physics.forward()
    now = data.qpos[ARM]
    proposals = _pushing_in(slot, data, np.random.default_rng(0), 5)
    assert len(proposals) > 0
    for path in plans_of(now, proposals, 5):
        np.testing.assert_array_equal(path[:, :4], np.repeat(now[None], 5, axis=0))
