"""Paths through waypoints, and the length that remains."""

import numpy as np
import pytest

from limberjack.planner.arm.path import Path, joint_sum, joint_time

_BENT = np.array([[0.0, 0, 0, 0], [0.0, 1, 0, 0], [0.0, 1, 0, 1]])


def test_the_length_is_that_along_the_waypoints() -> None:
    path = Path(_BENT, joint_sum)
    assert path.length == 2.0
    assert not path.is_straight
    assert Path(_BENT[:2], joint_sum).is_straight
    assert Path(_BENT, joint_time).length == 1.75  # the shoulder is quicker than the wrist
    np.testing.assert_array_equal(path.goal, _BENT[-1:])


def test_joints_ahead_are_at_multiples_of_an_arc_length_and_then_at_the_end() -> None:
    ahead = Path(_BENT, joint_sum).ahead(0.75, 3)
    np.testing.assert_array_equal(ahead, [[0, 0.75, 0, 0], [0, 1, 0, 0.5], [0, 1, 0, 1]])


def test_what_remains_falls_along_the_path_and_rises_beside_it() -> None:
    path = Path(_BENT, joint_sum)
    along = path.remaining(np.array([[0, 0, 0, 0], [0, 0.5, 0, 0], [0, 1, 0, 0.5], [0, 1, 0, 1.0]]))
    # As far as its points are apart, for joints between two of them.
    np.testing.assert_allclose(along, [2.0, 1.5, 0.5, 0.0], atol=0.1)
    beside = path.remaining(np.array([[0.2, 0.5, 0, 0]]))
    assert beside[0] == pytest.approx(along[1] + 1.3 * 0.2, abs=0.1)


def test_going_straight_to_points_behind_a_bend_costs_more_unless_they_are_in_sight() -> None:
    waypoints, begin = np.array([[0.0, 0, 0, 0], [0.0, 2, 0, 0], [0.5, 0, 0, 0]]), np.zeros((1, 4))
    blocked = Path(waypoints, joint_sum)
    seen = Path(waypoints, joint_sum, sights=lambda points: lambda point: len(points) - 1)
    assert seen.remaining(begin)[0] < 0.7 < blocked.remaining(begin)[0]


def test_points_that_are_covered_are_not_ahead() -> None:
    path = Path(_BENT, joint_sum, view=8)
    path.advance(np.array([0.0, 0.5, 0, 0]))
    first = path.next_points(1)[0]
    assert first[1] > 0.5
    np.testing.assert_array_equal(path.next_points(1)[-1], _BENT[-1])
    path.advance(np.array([0.0, 0.8, 0, 0]))
    assert not path.is_astray


def test_an_arm_that_makes_no_headway_for_long_is_stalled() -> None:
    path = Path(np.array([[0.0, 0, 0, 0], [3.0, 0, 0, 0]]), joint_sum)

    def is_stalled(left: float) -> bool:
        path.advance(np.array([3.0 - left, 0, 0, 0]))
        # As far as its points are apart, for joints between two of them.
        assert path.left == pytest.approx(left, abs=0.05)
        return path.is_stalled

    assert not any(is_stalled(2.0) for _ in range(29))
    assert not is_stalled(1.7)  # headway
    assert not any(is_stalled(1.7) for _ in range(28))
    assert is_stalled(1.7)


def test_an_arm_far_off_the_path_is_astray() -> None:
    path = Path(_BENT, joint_sum)
    for off, is_astray in (((0.5, 0.0), False), ((0.5, 0.5), True)):
        path.advance(np.array([off[0], 0.0, off[1], 0.0]))
        assert path.is_astray == is_astray
