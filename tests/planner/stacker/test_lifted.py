"""Paths of the arm: straight ones, and ways over what stands in between."""

import numpy as np

from limberjack.planner.arm.hand import CLOSED, OPEN
from limberjack.planner.arm.kinematics import GRASP, angle_of, hand_places, hand_poses
from limberjack.planner.stacker.lifted import later, plans_over, turning_over
from limberjack.planner.stacker.stack import Stack

_SETTINGS = Stack.settings
_CLOSE = 1e-9  # metres; closed forms there and back round by 1e-16
_DOWN = angle_of(np.array([0.0, -1.0]))


def _poses(x: float, z: float, count: int) -> np.ndarray:
    found = hand_poses(
        np.random.default_rng(0), np.array([x, z]), GRASP, np.zeros(4), count, _DOWN, 0.2
    )
    assert len(found) == count
    return found


def test_a_way_over_goes_up_first_and_comes_down_at_its_end() -> None:
    now, ends = _poses(0.25, 0.1, 1)[0], _poses(0.05, 0.08, 3)
    cruise = 0.2
    ways = plans_over(_SETTINGS, now, ends, cruise, GRASP, 0.0, [OPEN, CLOSED])
    assert ways.shape[1:] == (_SETTINGS.knots, 5)
    straight, over = ways[-len(ends) :], ways[: -len(ends)]
    assert len(over) > len(ends)
    np.testing.assert_array_equal(straight[:, -1, :4], ends)
    places = hand_places(over[..., :4], GRASP)
    # All begin where the hand is.
    assert (np.abs(places[:, 0] - [0.25, 0.1]) < _CLOSE).all()
    # The last metres of quick ones lead down to an end.
    arrived = np.abs(places[:, -1] - [0.05, 0.08]).max(axis=-1) < _CLOSE
    assert arrived.any()
    assert (over[arrived][:, -1, 4] == CLOSED).all()
    is_between = (places[..., 0] > 0.06) & (places[..., 0] < 0.24)
    assert is_between.any()
    assert (places[is_between][:, 1] > cruise - _CLOSE).all()


def test_each_way_over_may_have_its_own_grasp() -> None:
    now, ends = _poses(0.25, 0.1, 1)[0], _poses(0.05, 0.08, 2)
    grasps = [[-0.5, 0.5], [-0.25, 0.25]]
    both = plans_over(_SETTINGS, now, ends, 0.2, GRASP, 0.0, grasps)
    parts = [
        plans_over(_SETTINGS, now, end[None], 0.2, GRASP, 0.0, grasp)
        for end, grasp in zip(ends, grasps, strict=True)
    ]
    expected = np.concatenate([*(ways[:-1] for ways in parts), *(ways[-1:] for ways in parts)])
    np.testing.assert_array_equal(both, expected)


def test_later_ways_open_the_hand_first() -> None:
    ways = plans_over(
        _SETTINGS, np.zeros(4), _poses(0.1, 0.2, 2), 0.2, GRASP, 0.0, [CLOSED, CLOSED]
    )
    delayed = later(_SETTINGS, ways)
    knots = int((delayed[0, :, 4] == OPEN).sum())
    assert knots >= 1
    np.testing.assert_array_equal(delayed[:, knots:], ways[:, :-knots])
    np.testing.assert_array_equal(delayed[:, :knots, :4], np.repeat(ways[:, :1, :4], knots, axis=1))


def test_a_fingertip_that_turns_a_box_over_moves_to_the_side_that_it_is_told() -> None:
    now, box = _poses(0.1, 0.3, 1)[0], np.array([0.15, 0.022])
    for side in (1.0, -1.0):
        ways = turning_over(_SETTINGS, now, box, side, np.random.default_rng(0))
        assert len(ways) >= 3
        hands = hand_places(ways[..., :4], GRASP)[..., 0]
        assert (side * (hands[:, -1] - hands[:, 2]) > 0).all()
