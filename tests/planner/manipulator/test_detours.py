"""Routes of the planar arm between floor and walls."""

import itertools

import numpy as np

from limberjack.planner.arm.collision import hand_gap, is_clear
from limberjack.planner.arm.kinematics import GRASP, hand_places, hand_poses, nudged
from limberjack.planner.arm.path import Path, joint_time
from limberjack.planner.manipulator.detours import find_detours, keep_clear

_REACH = 0.178


def _goals(point: tuple[float, float], angle: float) -> np.ndarray:
    random = np.random.default_rng(1)
    return hand_poses(random, np.array(point), GRASP, np.zeros(4), 12, angle, 0.1)


def test_all_of_a_route_is_clear_and_it_ends_at_a_goal() -> None:
    now = hand_poses(np.random.default_rng(0), np.array([0.2, 0.15]), GRASP, np.zeros(4), 1)[0]
    goals = _goals((-0.2, 0.2), 1.5)
    found = find_detours(np.random.default_rng(2), now, goals[:, None], _REACH)
    assert 0 < len(found) <= 6
    lengths = []
    for route in found:
        waypoints = route.waypoints
        for start, end in itertools.pairwise(waypoints):
            line = start + np.arange(1, 7)[:, None] / 6 * (end - start)
            assert is_clear(line, _REACH).all()
        ends = np.array([hand_places(goal, GRASP) for goal in goals])
        place = hand_places(route.waypoints[-1], GRASP)
        assert np.abs(ends - place).max(axis=-1).min() < 1e-9
        # Shorter where the joints of its two parts turn at different rates.
        assert 0.8 * route.length <= route.remaining(now[None])[0] <= 1.001 * route.length
        np.testing.assert_array_equal(route.remaining(waypoints[-1][None]), 0.0)
        lengths.append(route.length)
    assert lengths == sorted(lengths)


def test_there_is_no_route_to_nowhere_nor_through_the_floor() -> None:
    assert find_detours(np.random.default_rng(0), np.zeros(4), np.zeros((0, 1, 4)), _REACH) == []
    under = np.array([[[np.pi, 0.0, 0.0, 0.0]]])
    assert find_detours(np.random.default_rng(0), np.zeros(4), under, _REACH) == []


def test_a_route_is_gone_in_equal_strides_to_its_end() -> None:
    goals = _goals((-0.2, 0.2), 1.5)[:, None]
    route = find_detours(np.random.default_rng(2), np.zeros(4), goals, _REACH)[0]
    ahead = route.ahead(route.length / 4, 6)
    left = route.remaining(ahead)
    expected = route.length * np.array([0.75, 0.5, 0.25, 0, 0, 0])
    # As far as its points are apart, for a place between two of them.
    np.testing.assert_allclose(left, expected, atol=0.05)
    np.testing.assert_array_equal(ahead[-1], route.waypoints[-1])


def test_a_known_route_is_not_lost() -> None:
    now, goals = np.array([1.0, 1.0, 1.0, 0.5]), _goals((-0.2, 0.2), 1.5)[:, None]
    found = find_detours(np.random.default_rng(2), now, goals, _REACH)
    again = find_detours(np.random.default_rng(3), now, goals, _REACH, known=found)
    assert again[0].length <= found[0].length


def test_a_route_goes_around_a_line_and_first_where_it_is_told() -> None:
    line = np.array([[0.1, 0.03], [0.2, 0.01]])
    above = hand_poses(np.random.default_rng(0), np.array([0.15, 0.2]), GRASP, np.zeros(4), 1)[0]
    goals = _goals((0.0, 0.05), -2.0)[:, None]
    lifted = nudged(above, np.array([0.0, 0.02]), 0.0)
    found = find_detours(np.random.default_rng(2), above, goals, 0.1, around=line, first=lifted)
    assert found
    for route in found:
        waypoints = route.waypoints[1:]
        for start, end in itertools.pairwise(waypoints):
            between = start + np.arange(1, 7)[:, None] / 6 * (end - start)
            assert (hand_gap(between, line) > 0.0249).all()
        length = Path(route.waypoints[1:], joint_time).length
        # As far as its points are apart, for a place between two of them.
        np.testing.assert_allclose(route.remaining(lifted[None])[0], length, atol=0.05)


def test_known_routes_are_kept_as_far_as_they_are_clear_and_lose_stops_that_are_passed() -> None:
    now, goals = np.array([1.0, 1.0, 1.0, 0.5]), _goals((-0.2, 0.2), 1.5)[:, None]
    found = find_detours(np.random.default_rng(2), now, goals, _REACH)
    assert any(route.via is not None for route in found)
    again = keep_clear(now, found, _REACH)
    assert [route.length for route in again] == [route.length for route in found]
    for route in found:
        near_end = route.ahead(0.9 * route.length, 1)[0]
        (alone,) = keep_clear(near_end, [route], _REACH)
        assert alone.via is None  # the goal is in sight
        np.testing.assert_array_equal(alone.waypoints[1:], route.goal)
        assert alone.length < 0.2 * route.length
    folded = np.array([1.0, 3.0, 3.0, 0.5])  # into itself
    assert keep_clear(folded, found, _REACH) == []
    assert keep_clear(now, [], _REACH) == []
