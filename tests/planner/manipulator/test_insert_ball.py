"""Insertion of the ball: paths to it, its release, and its recovery from the arm."""

import numpy as np
import pytest

from limberjack.planner.arm.hand import ARM, OPEN_ANGLE
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.manipulator.fetch import Stage

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]
_JOINTS = ["ball_x", "ball_z"]


def test_a_ball_that_rests_on_high_is_shaken_off_and_one_in_the_cup_is_not() -> None:
    cost, physics = scene("insert_ball", 1058, _ARM, [0.0, 0.3, 0.0])
    data = physics.named.data
    for place, stage in (((-0.2, 0.3), Stage.SHAKE), (None, Stage.LEAVE)):
        cost.reset()
        data.qpos[_JOINTS] = data.site_xpos["target_ball"][[0, 2]] if place is None else place
        physics.forward()
        for _ in range(12):
            cost.update(physics)
        assert cost.stage()[0] is stage
        found = cost.proposals(physics, np.random.default_rng(0))
        turns = np.abs(found[:, -1, :4] - data.qpos[ARM]).max(axis=-1)
        assert (turns > 0.3).all() == (stage is Stage.SHAKE)


def test_an_arm_waits_with_an_open_hand_until_the_ball_has_rolled_in_or_missed() -> None:
    cost, physics = scene("insert_ball", 1058, _ARM, [0.0, 0.3, 0.0])
    data, release = physics.named.data, cost._release
    data.qpos[_JOINTS] = data.site_xpos["target_ball"][[0, 2]] + [0.05, 0.05]
    physics.forward()
    release.waits, release._kept = 3, np.array(_ARM)
    cost.update(physics)
    assert cost.stage()[0] is Stage.RELEASE
    (plan,) = cost.proposals(physics, np.random.default_rng(0))
    np.testing.assert_array_equal(plan[:, :4], np.repeat([_ARM], len(plan), axis=0))
    assert (plan[:, 4] < OPEN_ANGLE).all()
    assert list(cost.terms(physics)) == ["reward", "arm astray", "closed fingers"]
    data.qpos[_JOINTS] = data.site_xpos["target_ball"][[0, 2]] + [0.0, 0.4]
    physics.forward()
    cost.update(physics)
    assert cost.stage()[0] is not Stage.RELEASE


@pytest.mark.parametrize(("speed", "height"), [(0.0, None), (2.0, 0.04)])
def test_a_path_leads_before_the_ball_or_to_where_a_rolling_one_is_awaited(
    speed: float, height: float | None
) -> None:
    cost, physics = scene("insert_ball", 1003, _ARM, [0.1, 0.022, 0.0])
    physics.named.data.qvel["ball_x"] = speed
    goals = cost._insertion._goals(physics.named.data)
    assert len(goals)
    hands = hand_places(goals, GRASP + 0.06)
    if height is not None:
        # The arm's Jacobian is followed in a few steps.
        np.testing.assert_allclose(hands[:, 1], height, atol=2e-3)
        assert np.ptp(hands[:, 0]) > 0.2
        return
    assert np.abs(hands - [0.1, 0.022]).max() < 0.03


def test_proposals_open_the_hand_above_the_mouth() -> None:
    place = hand_places(np.array(_ARM), GRASP)
    cost, physics = scene("insert_ball", 1003, _ARM, [*place, 0.0])
    found = cost._insertion.proposals_in(physics.named.data, np.random.default_rng(0))
    assert len(found) > 4
    assert {proposal.grasp[-1] for proposal in found} == {OPEN_ANGLE, cost._fetch.prop.grip.ready}
