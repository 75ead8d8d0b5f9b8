"""The ball and the peg as objects to grasp."""

from typing import Any

import numpy as np
import pytest

from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, TIPS, in_hand
from limberjack.planner.arm.kinematics import GRASP, PINCH, direction, hand_places, hand_poses
from limberjack.planner.arm.proposals import approaches, plans_of
from limberjack.planner.manipulator.props import (
    Ball,
    Peg,
    across,
    against_hand,
    downwards,
    grasp_of,
    grasp_place,
    height_above_ground,
    in_world,
    is_on_arm,
    pose_of,
    prop_of,
)

from .scenes import lying_peg, scene

_ARM = [0.0, 0.7, 0.7, 0.7]


def _prop(task: str, ahead: float = 0.0) -> tuple[Any, Any]:
    """The prop and the physics of a hand around it, or so far before it."""
    place = hand_places(np.array(_ARM), GRASP + ahead)
    cost, physics = scene(task, 1000, _ARM, [*place, np.pi - sum(_ARM)])
    return prop_of(cost.task), physics


def test_a_hand_comes_to_a_lying_peg_from_above_whichever_way_it_lies() -> None:
    for tip_to in (-1.0, 1.0):
        place, frame = lying_peg(tip_to)
        point, angle = grasp_of((place, frame))
        blade = -frame[[2, 8]]
        assert np.sign(blade[0]) == tip_to
        assert direction(angle)[1] < blade[1] - 0.2
        assert direction(angle) @ blade > 0.95
        assert np.abs(point - (place + 0.034 * frame[2::3])[[0, 2]]).max() < 0.003


def test_a_peg_too_deep_in_the_hand_is_given_back() -> None:
    offset = np.array([0.0, -0.03, -0.03, -0.2]), np.array([0.0, 0.0, 0.1, 0.0])
    expected = [Peg.ready, OPEN_ANGLE, Peg.ready, Peg.ready]
    assert Peg([]).opening(offset).tolist() == expected
    assert Ball([]).opening(offset) == Ball.ready


def test_approaches_come_straight_on_and_close_at_the_peg() -> None:
    _, physics = _prop("bring_peg")
    point, angle = grasp_of(lying_peg(1.0))
    pose = hand_poses(np.random.default_rng(0), point, PINCH, np.zeros(4), 8, angle, 0.05)[0]
    first = plans_of(np.zeros(4), approaches(pose[None], Peg.ready, Peg.shut), 5)[0]
    np.testing.assert_array_equal(first[3, :4], pose)
    assert first[:, 4].tolist() == [Peg.ready] * 4 + [Peg.shut]
    for joints, back in zip(first[1:4, :4], (0.06, 0.03, 0.0), strict=True):
        with physics.reset_context():
            physics.named.data.qpos[ARM] = joints
        ahead, aside = in_hand(physics.named.data, np.array([point[0], 0.0, point[1]]))
        # The arm's Jacobian is followed in a few steps.
        np.testing.assert_allclose([ahead, aside], [back + PINCH - GRASP, 0.0], atol=1e-4)


@pytest.mark.parametrize("task", ["bring_ball", "bring_peg"])
def test_a_prop_is_firm_only_between_closed_fingers(task: str) -> None:
    for ahead, angle, least, most in (
        (0.0, "firm", 0.5, 1.0),
        (0.0, "ready", 0.0, 0.01),
        (0.2, "firm", 0.0, 0.01),
    ):
        prop, physics = _prop(task, ahead)
        data = physics.named.data
        data.qpos[["thumb", "finger"]] = getattr(prop, angle)
        physics.forward()
        assert least <= prop.firmness(data, prop.offset(data)) <= most


def test_a_swung_peg_costs_and_a_swung_ball_does_not() -> None:
    peg, physics = _prop("bring_peg")
    physics.named.data.qvel[peg.joints] = 4.0, 0.0, 12.0
    assert [float(cost) for cost in peg.swung(physics.named.data)] == [0.5, 0.1]
    assert Ball([]).swung(physics.named.data) == []


def test_fingertips_across_a_turned_peg_cost() -> None:
    _, physics = _prop("bring_peg")
    data = physics.named.data
    data.geom_xpos[TIPS] = data.site_xpos["peg"]
    assert across(data, 0.0) == 0.0
    assert across(data, 1.0) > 0.0


def test_a_peg_is_on_the_arm_only_where_it_touches_it_on_high() -> None:
    for peg, expected in (([-0.177, 0.336, -0.90], True), ([0.3, 0.02, 1.3], False)):
        _, physics = scene("bring_peg", 1000, [2.72, -1.57, 0.34, 2.17], peg)
        assert is_on_arm(physics.named.data) == expected


def test_a_peg_is_raked_towards_the_side_of_its_handle() -> None:
    goals = []
    for angle in (1.3, -1.3):
        cost, physics = scene("bring_peg", 1000, _ARM, [0.45, 0.1, angle])
        goals.append(prop_of(cost.task).rake_goal(physics.named.data))
    assert goals[0] == -goals[1] != 0.0


@pytest.mark.parametrize("prop", [Ball, Peg])
def test_fingers_come_wider_than_the_object_and_press_narrower(prop: Any) -> None:
    assert prop.ready < prop.firm < prop.shut


def test_a_grip_is_firm_with_the_object_between_closed_fingers_or_a_little_deeper() -> None:
    _, physics = scene("bring_ball", 1000, _ARM, [0.0, 0.3, 0.0])
    data = physics.named.data
    data.qpos[["thumb", "finger"]] = Ball.firm
    ahead, aside = np.array([0.0, Ball.slack, -0.05, 0.0]), np.array([0.0, 0.0, 0.0, 0.05])
    firm = Ball([]).firmness(data, (ahead, aside))
    assert firm[0] == firm[1] == pytest.approx(1.0)  # angles round
    assert (firm[2:] < 0.01).all()
    data.qpos[["thumb", "finger"]] = Ball.ready
    assert Ball([]).firmness(data, (0.0, 0.0)) == 0.0


def test_a_peg_is_grasped_at_its_handle() -> None:
    handle = hand_places(np.array(_ARM), GRASP)
    _, physics = scene("bring_peg", 1000, _ARM, [*handle, np.pi - sum(_ARM)])
    data = physics.named.data
    # Sines and cosines round.
    np.testing.assert_allclose(in_hand(data, grasp_place(data, "peg", Peg)), [0.0, 0.0], atol=1e-9)
    forward = in_world(pose_of(data, "peg")[1], Peg.forward)
    assert against_hand(data, forward) == pytest.approx(0.0, abs=1e-9)
    assert against_hand(data, -forward) == pytest.approx(2.0)


def test_height_and_down_follow_the_walls() -> None:
    places = np.array([[0.0, 0.0, 0.1], [0.5, 0.0, 0.1], [-0.5, 0.0, 0.1]])
    np.testing.assert_allclose(height_above_ground(places), [0.1, 0.0, 0.0], atol=1e-15)  # rounds
    side = np.sqrt(0.5)
    expected = [[0, 0, -1], [side, 0, -side], [-side, 0, -side]]
    np.testing.assert_allclose(downwards(places), expected, atol=1e-15)  # sines and cosines round


def test_the_pose_of_a_site_is_a_copy() -> None:
    _, physics = scene("bring_ball", 1000, _ARM, [0.0, 0.3, 0.0])
    place, _ = pose_of(physics.named.data, "ball")
    physics.named.data.qpos["ball_x"] = 0.2
    physics.forward()
    assert place[0] == 0.0
