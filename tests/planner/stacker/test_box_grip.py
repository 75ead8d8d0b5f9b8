"""Grips on a box: firm, slipping and missing ones."""

import numpy as np

from limberjack.planner.stacker.box_grip import HIGH, Grip, fetching, how_held, ready

_FIRM = Grip(
    ahead=HIGH, aside=0.0, askew=0.0, closed=np.radians(24.0), turning=np.array(0.0), tilt=0.0
)


def _held(has: bool, **changes: float) -> float:
    changed = {name: np.array(value) for name, value in changes.items()}
    return float(how_held(_FIRM._replace(**changed), has))


def test_a_firm_grip_holds() -> None:
    assert _held(False) == 1.0
    assert _held(True) == 1.0


def test_a_box_is_not_taken_while_the_fingers_turn_or_by_its_edge() -> None:
    assert _held(False, turning=1.7) < 0.1
    assert _held(False, ahead=0.045) < 0.3


def test_a_box_that_has_crept_to_the_tips_is_still_held() -> None:
    assert _held(True, turning=1.7) == 1.0
    assert _held(True, ahead=0.045) == 1.0


def test_nothing_is_held_by_fingers_that_are_open_shut_or_elsewhere() -> None:
    for changes in ({"closed": 0.0}, {"closed": 1.0}, {"aside": 0.05}, {"ahead": 0.1}):
        assert _held(True, **changes) < 0.01, changes


def test_who_is_there_should_close_and_who_is_not_should_not() -> None:
    there, far = _FIRM, _FIRM._replace(ahead=HIGH + 0.06)
    open_there, open_far = (grip._replace(closed=0.0) for grip in (there, far))
    assert fetching(there) < fetching(open_there) < fetching(open_far) < fetching(far)


def test_fingers_open_around_a_box_that_is_askew() -> None:
    askew = _FIRM._replace(askew=np.array(0.1))
    assert fetching(askew._replace(closed=np.array(0.0))) < fetching(askew)


def test_fingers_that_come_to_a_box_are_neither_wide_open_nor_closed() -> None:
    assert ready(0.0) > 0.0 > ready(np.radians(24.0))
    there = _FIRM._replace(ahead=HIGH + 0.06)
    costs = [
        float(fetching(there._replace(closed=np.radians(angle)))) for angle in (-10.0, 6.0, 24.0)
    ]
    assert min(costs) == costs[1]
