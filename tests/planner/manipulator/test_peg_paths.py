"""Paths of the arm to a peg and with it."""

import numpy as np

from limberjack.planner.arm.kinematics import PINCH, hand_places, hand_poses
from limberjack.planner.manipulator.peg_paths import PegPaths
from limberjack.planner.manipulator.props import Peg, grasp_of

from .scenes import lying_peg

_UP = np.array([0.0, 1.0])


def _poses(point: np.ndarray, angle: float) -> np.ndarray:
    return hand_poses(np.random.default_rng(0), point, PINCH, np.zeros(4), 8, angle, 0.05)


def test_costs_end_with_those_of_hand_and_peg() -> None:
    paths, near_cost = PegPaths(np.random.default_rng(0)), np.array([0.3])
    now = np.array([1.0, 1.0, 1.0, 0.5])
    np.testing.assert_array_equal(paths.cost_to_peg(now[None], near_cost), near_cost)
    np.testing.assert_array_equal(paths.cost_to_target(now[None], near_cost), near_cost)
    goals = _poses(np.array([-0.2, 0.2]), 1.5)
    paths.search_target(now, _UP, lambda: goals)
    assert paths.cost_to_target(now[None], near_cost)[0] > 3.0
    end = paths.plans(now, 40)[-1][-1]
    assert end[4] == Peg.shut
    np.testing.assert_array_equal(paths.cost_to_target(end[None, :4], near_cost), near_cost)
    paths.forget()
    assert paths.plans(now, 5).shape == (0, 5, 5)


def test_the_path_to_a_peg_ends_around_it_with_an_open_hand() -> None:
    paths, peg = PegPaths(np.random.default_rng(0)), lying_peg(1.0)
    now = np.array([1.0, 1.0, 1.0, 0.5])
    point, angle = grasp_of(peg)
    paths.search_peg(now, peg, lambda: _poses(point, angle))
    end = paths.plans(now, 40)[-1][-1]
    # Inverse kinematics and back, by sines and cosines: they round.
    np.testing.assert_allclose(hand_places(end[:4], PINCH), point, atol=1e-9)
    assert end[4] == Peg.ready
