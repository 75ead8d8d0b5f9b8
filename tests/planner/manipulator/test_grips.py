"""Grips of ball and peg."""

import numpy as np
import pytest

from limberjack.planner.arm.hand import in_hand
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.manipulator.grips import (
    BALL,
    HANDLE,
    Grip,
    against_hand,
    downwards,
    grasp_place,
    height_above_ground,
    in_world,
    pose_of,
)

from .scenes import scene

_ARM = [0.0, 0.7, 0.7, 0.7]


@pytest.mark.parametrize("grip", [BALL, HANDLE])
def test_fingers_come_wider_than_the_object_and_press_narrower(grip: Grip) -> None:
    assert grip.ready < grip.firm < grip.shut


def test_a_grip_is_firm_with_the_object_between_closed_fingers_or_a_little_deeper() -> None:
    _, physics = scene("bring_ball", 1000, _ARM, [0.0, 0.3, 0.0])
    data = physics.named.data
    data.qpos[["thumb", "finger"]] = BALL.firm
    ahead, aside = np.array([0.0, BALL.slack, -0.05, 0.0]), np.array([0.0, 0.0, 0.0, 0.05])
    firm = BALL.firmness(data, (ahead, aside))
    assert firm[0] == firm[1] == pytest.approx(1.0)  # angles round
    assert (firm[2:] < 0.01).all()
    data.qpos[["thumb", "finger"]] = BALL.ready
    assert BALL.firmness(data, (0.0, 0.0)) == 0.0


def test_a_peg_is_grasped_at_its_handle() -> None:
    handle = hand_places(np.array(_ARM), GRASP)
    _, physics = scene("bring_peg", 1000, _ARM, [*handle, np.pi - sum(_ARM)])
    data = physics.named.data
    # Sines and cosines round.
    np.testing.assert_allclose(
        in_hand(data, grasp_place(data, "peg", HANDLE)), [0.0, 0.0], atol=1e-9
    )
    assert HANDLE.forward is not None
    forward = in_world(pose_of(data, "peg")[1], HANDLE.forward)
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
