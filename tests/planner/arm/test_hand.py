"""Measurements of the hand, compared with positions in the model."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner.arm.hand import (
    ARM,
    OPEN_ANGLE,
    PLANE,
    TIP_ASIDE,
    TIP_REACH,
    TIPS,
    closing,
    finger_angle,
    fingers,
    in_hand,
    loose,
    near,
    outward_speed,
    sag,
)
from limberjack.planner.arm.kinematics import GRASP, direction, hand_places
from limberjack.planner.control_law import ControlLaw
from limberjack.planner.settings import Settings

_ARM = np.array([0.3, 0.7, -0.4, 0.9])


def _physics(angle: float = 0.0) -> Any:
    """A bent arm that keeps still, with its fingers at an angle and their tips straight."""
    env = suite.load("manipulator", "bring_ball", task_kwargs={"random": 1000})
    env.reset()
    physics, data = env.physics, env.physics.named.data
    data.qpos[ARM], data.qpos[["thumb", "finger"]], data.qvel[:] = _ARM, angle, 0.0
    data.qpos[["thumbtip", "fingertip"]] = 0.0
    physics.forward()
    return physics


def _tips_in_hand(physics: Any) -> np.ndarray:
    """Distances of the fingertips ahead of the wrist and aside of the hand's middle, (2, 2)."""
    data = physics.named.data
    ahead, aside = in_hand(data, data.geom_xpos[TIPS])
    return np.stack([ahead + GRASP, np.abs(aside)], axis=-1)


def test_a_position_in_the_hand_is_ahead_and_aside_of_the_grasp_site() -> None:
    data = _physics().named.data
    point = np.zeros(3)
    point[PLANE] = hand_places(_ARM, GRASP + 0.03, 0.01)
    # Closed forms on one side, MuJoCo's quaternions on the other: they round.
    np.testing.assert_allclose(in_hand(data, point), [0.03, 0.01], rtol=0, atol=1e-9)  # rounds


def test_the_reach_and_the_distance_aside_are_those_of_fingers_at_an_angle_of_zero() -> None:
    # As above: they round.
    expected = [[TIP_REACH, TIP_ASIDE]] * 2
    np.testing.assert_allclose(_tips_in_hand(_physics()), expected, rtol=0, atol=1e-9)  # rounds


@pytest.mark.parametrize("width", [0.01, 0.02, 0.04])
def test_fingers_at_their_angle_for_a_width_have_their_tips_there(width: float) -> None:
    aside = _tips_in_hand(_physics(finger_angle(width)))[:, 1]
    np.testing.assert_allclose(aside, width, rtol=0, atol=1e-9)  # sines and cosines round


def test_fingers_are_measured_by_the_mean_of_both_and_from_fully_open() -> None:
    data = _physics(OPEN_ANGLE).named.data
    assert (fingers(data), closing(data)) == (OPEN_ANGLE, 0.0)
    data.qpos[["thumb", "finger"]] = 0.5, 0.25
    assert fingers(data) == 0.375
    assert closing(data) == 0.375 - OPEN_ANGLE > 0.375


def test_closeness_falls_from_one_over_a_half_at_the_scale() -> None:
    values = near(np.array([0.0, 0.01, 0.02, 0.2]), 0.02)
    assert values[0] == 1.0
    assert values[2] == 0.5
    assert (np.diff(values) < 0).all()
    assert values[3] < 1e-3


def test_a_grasp_that_presses_too_little_costs() -> None:
    physics = _physics()
    for control, cost in ((-1.0, 0.15 * 1.25), (0.25, 0.0), (1.0, 0.0)):
        physics.set_control(np.array([0.0, 0.0, 0.0, 0.0, control]))
        assert loose(physics, 0.25) == cost


def test_targets_raised_by_the_sag_hold_the_arm_against_gravity() -> None:
    physics, gain = _physics(), 5.0
    data, law = physics.named.data, ControlLaw(physics.model.ptr, Settings(gain=gain))
    targets = np.append(_ARM + sag(physics, gain), -1.0)
    physics.set_control(law.controls(targets, physics.position(), physics.velocity()))
    physics.forward()
    # Products of gains and gears in another order: they round.
    bias = data.qfrc_bias[ARM]
    assert np.abs(bias).max() > 0.1
    np.testing.assert_allclose(data.qfrc_actuator[ARM], bias, rtol=1e-9)  # sums round


def test_only_motion_away_from_the_middle_is_outward() -> None:
    data = _physics().named.data
    expected = ((0.2, 0.5, 0.5), (-0.2, 0.5, 0.0), (-0.2, -0.5, 0.5), (0.2, 9.0, 2.0))
    for place, velocity, speed in expected:
        data.site_xpos["ball"][0], data.qvel["ball_x"] = place, velocity
        assert outward_speed(data, "ball_x", "ball") == speed


def test_the_hand_points_where_its_joints_turn_it() -> None:
    hand = _physics().named.data.site_xmat["grasp"]
    np.testing.assert_allclose(hand[[2, 8]], direction(_ARM.sum()), atol=1e-9)  # rounds
