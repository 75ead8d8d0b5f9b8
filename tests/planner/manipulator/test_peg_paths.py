"""Paths of the arm to a peg and with it."""

import numpy as np

from limberjack import suite
from limberjack.planner.arm.hand import ARM, OPEN_ANGLE, in_hand
from limberjack.planner.arm.kinematics import GRASP, PINCH, direction, hand_places, hand_poses
from limberjack.planner.arm.proposals import approaches, plans_of
from limberjack.planner.manipulator.grips import HANDLE, Pose
from limberjack.planner.manipulator.peg_paths import PegPaths, grasp_of, opening

_UP = np.array([0.0, 1.0])


def _lying_peg(tip_to: float) -> Pose:
    """On the floor, its tip to the left or the right; it leans on its guard."""
    lean = tip_to * np.radians(-76.4)
    frame = np.array([np.cos(lean), 0, np.sin(lean), 0, 1, 0, -np.sin(lean), 0, np.cos(lean)])
    return np.array([0.1, 0.0, 0.017]), frame


def _poses(point: np.ndarray, angle: float) -> np.ndarray:
    return hand_poses(np.random.default_rng(0), point, PINCH, np.zeros(4), 8, angle, 0.05)


def test_a_hand_comes_to_a_lying_peg_from_above_whichever_way_it_lies() -> None:
    for tip_to in (-1.0, 1.0):
        place, frame = _lying_peg(tip_to)
        point, angle = grasp_of((place, frame))
        blade = -frame[[2, 8]]
        assert np.sign(blade[0]) == tip_to
        assert direction(angle)[1] < blade[1] - 0.2
        assert direction(angle) @ blade > 0.95
        assert np.abs(point - (place + 0.034 * frame[2::3])[[0, 2]]).max() < 0.003


def test_costs_end_with_what_hand_and_peg_tell() -> None:
    paths, near_cost = PegPaths(), np.array([0.3])
    now = np.array([1.0, 1.0, 1.0, 0.5])
    np.testing.assert_array_equal(paths.cost_to_peg(now[None], near_cost), near_cost)
    np.testing.assert_array_equal(paths.cost_to_target(now[None], near_cost), near_cost)
    goals = _poses(np.array([-0.2, 0.2]), 1.5)
    paths.look_for_target(np.random.default_rng(0), now, _UP, lambda _: goals)
    assert paths.cost_to_target(now[None], near_cost)[0] > 3.0
    end = paths.plans(now, 40)[-1][-1]
    assert end[4] == HANDLE.shut
    np.testing.assert_array_equal(paths.cost_to_target(end[None, :4], near_cost), near_cost)
    paths.forget()
    assert paths.plans(now, 5).shape == (0, 5, 5)


def test_the_path_to_a_peg_ends_around_it_with_an_open_hand() -> None:
    paths, peg = PegPaths(), _lying_peg(1.0)
    now = np.array([1.0, 1.0, 1.0, 0.5])
    point, angle = grasp_of(peg)
    paths.look_for_peg(np.random.default_rng(0), now, peg, lambda _: _poses(point, angle))
    end = paths.plans(now, 40)[-1][-1]
    # Inverse kinematics and back, by sines and cosines: they round.
    np.testing.assert_allclose(hand_places(end[:4], PINCH), point, atol=1e-9)
    assert end[4] == HANDLE.ready


def test_what_is_too_deep_in_the_hand_is_given_back() -> None:
    ahead, aside = np.array([0.0, -0.03, -0.03, -0.2]), np.array([0.0, 0.0, 0.1, 0.0])
    expected = [HANDLE.ready, OPEN_ANGLE, HANDLE.ready, HANDLE.ready]
    assert opening(ahead, aside).tolist() == expected


def test_approaches_come_straight_on_and_close_at_the_peg() -> None:
    physics = suite.load("manipulator", "bring_peg", task_kwargs={"random": 0}).physics
    point, angle = grasp_of(_lying_peg(1.0))
    pose = _poses(point, angle)[0]
    first = plans_of(np.zeros(4), approaches(pose[None], HANDLE.ready, HANDLE.shut), 5)[0]
    np.testing.assert_array_equal(first[3, :4], pose)
    assert first[:, 4].tolist() == [HANDLE.ready] * 4 + [HANDLE.shut]
    for joints, back in zip(first[1:4, :4], (0.06, 0.03, 0.0), strict=True):
        with physics.reset_context():
            physics.named.data.qpos[ARM] = joints
        ahead, aside = in_hand(physics.named.data, np.array([point[0], 0.0, point[1]]))
        # The arm's Jacobian is followed in a few steps.
        np.testing.assert_allclose([ahead, aside], [back + PINCH - GRASP, 0.0], atol=1e-4)
