"""Paths of the arm between floor and walls, to a peg and with it."""

import itertools

import numpy as np

from limberjack.planner.arm.collision import hand_gap, is_clear
from limberjack.planner.arm.kinematics import GRASP, PINCH, hand_places, hand_poses, nudged
from limberjack.planner.arm.path import Path, joint_time
from limberjack.planner.manipulator.peg_paths import Detours, PegPaths
from limberjack.planner.manipulator.props import Peg, grasp_of

from .scenes import lying_peg

_DETOURS = Detours(0.178)


def _goals(point: tuple[float, float], angle: float) -> np.ndarray:
    random = np.random.default_rng(1)
    return hand_poses(random, np.array(point), GRASP, np.zeros(4), 12, angle, 0.1)


def test_all_of_a_path_is_clear_and_it_ends_at_a_goal() -> None:
    now = hand_poses(np.random.default_rng(0), np.array([0.2, 0.15]), GRASP, np.zeros(4), 1)[0]
    goals = _goals((-0.2, 0.2), 1.5)
    found = _DETOURS.find(np.random.default_rng(2), now, goals[:, None])
    assert 0 < len(found) <= 6
    lengths = []
    for path in found:
        waypoints = path.waypoints
        for start, end in itertools.pairwise(waypoints):
            line = start + np.arange(1, 7)[:, None] / 6 * (end - start)
            assert is_clear(line, _DETOURS.reach).all()
        ends = np.array([hand_places(goal, GRASP) for goal in goals])
        place = hand_places(path.waypoints[-1], GRASP)
        assert np.abs(ends - place).max(axis=-1).min() < 1e-9
        # Shorter where the joints of its two parts turn at different rates.
        assert 0.8 * path.length <= path.remaining(now[None])[0] <= 1.001 * path.length
        np.testing.assert_array_equal(path.remaining(waypoints[-1][None]), 0.0)
        lengths.append(path.length)
    assert lengths == sorted(lengths)


def test_there_is_no_path_to_nowhere_nor_through_the_floor() -> None:
    assert _DETOURS.find(np.random.default_rng(0), np.zeros(4), np.zeros((0, 1, 4))) == []
    under = np.array([[[np.pi, 0.0, 0.0, 0.0]]])
    assert _DETOURS.find(np.random.default_rng(0), np.zeros(4), under) == []


def test_a_path_is_gone_in_equal_strides_to_its_end() -> None:
    goals = _goals((-0.2, 0.2), 1.5)[:, None]
    path = _DETOURS.find(np.random.default_rng(2), np.zeros(4), goals)[0]
    ahead = path.ahead(path.length / 4, 6)
    left = path.remaining(ahead)
    expected = path.length * np.array([0.75, 0.5, 0.25, 0, 0, 0])
    # As far as its points are apart, for a place between two of them.
    np.testing.assert_allclose(left, expected, atol=0.05)
    np.testing.assert_array_equal(ahead[-1], path.waypoints[-1])


def test_a_known_path_is_not_lost() -> None:
    now, goals = np.array([1.0, 1.0, 1.0, 0.5]), _goals((-0.2, 0.2), 1.5)[:, None]
    found = _DETOURS.find(np.random.default_rng(2), now, goals)
    again = _DETOURS.find(np.random.default_rng(3), now, goals, known=found)
    assert again[0].length <= found[0].length


def test_a_path_goes_around_a_line_and_first_where_it_is_told() -> None:
    line = np.array([[0.1, 0.03], [0.2, 0.01]])
    above = hand_poses(np.random.default_rng(0), np.array([0.15, 0.2]), GRASP, np.zeros(4), 1)[0]
    goals = _goals((0.0, 0.05), -2.0)[:, None]
    lifted = nudged(above, np.array([0.0, 0.02]), 0.0)
    found = Detours(0.1, line, lifted).find(np.random.default_rng(2), above, goals)
    assert found
    for path in found:
        waypoints = path.waypoints[1:]
        for start, end in itertools.pairwise(waypoints):
            between = start + np.arange(1, 7)[:, None] / 6 * (end - start)
            assert (hand_gap(between, line) > 0.0249).all()
        length = Path(path.waypoints[1:], joint_time).length
        # As far as its points are apart, for a place between two of them.
        np.testing.assert_allclose(path.remaining(lifted[None])[0], length, atol=0.05)


def test_known_paths_are_kept_as_far_as_they_are_clear_and_lose_stops_that_are_passed() -> None:
    now, goals = np.array([1.0, 1.0, 1.0, 0.5]), _goals((-0.2, 0.2), 1.5)[:, None]
    found = _DETOURS.find(np.random.default_rng(2), now, goals)
    assert any(path.via is not None for path in found)
    again = _DETOURS.keep(now, found)
    assert [path.length for path in again] == [path.length for path in found]
    for path in found:
        near_end = path.ahead(0.9 * path.length, 1)[0]
        (alone,) = _DETOURS.keep(near_end, [path])
        assert alone.via is None  # the goal is in sight
        np.testing.assert_array_equal(alone.waypoints[1:], path.goal)
        assert alone.length < 0.2 * path.length
    folded = np.array([1.0, 3.0, 3.0, 0.5])  # into itself
    assert _DETOURS.keep(folded, found) == []
    assert _DETOURS.keep(now, []) == []


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
