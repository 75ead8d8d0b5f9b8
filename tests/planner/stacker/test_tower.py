"""The choice of the next box of a tower."""

from typing import Any

import numpy as np

from limberjack.planner.stacker.boxes import HALF
from limberjack.planner.stacker.tower import Tower

from .scenes import scene

_BOXES = ["box0", "box1"]


def _data(places: list[tuple[float, float]]) -> Any:
    """Two boxes at rest at x and z; the target is the second level at x = 0."""
    return scene(places)[1].named.data


def test_the_nearest_box_is_next_and_goes_to_the_floor_first() -> None:
    tower = Tower(_BOXES)
    tower.update(_data([(0.3, HALF), (0.2, HALF)]), False)
    assert (tower.placed, tower.next, tower.waiting) == ([], "box1", ["box0"])
    np.testing.assert_array_equal(tower.place, [0.0, 0.0, HALF])


def test_a_box_in_place_carries_the_next_one() -> None:
    tower = Tower(_BOXES)
    tower.update(_data([(0.001, HALF), (0.2, HALF)]), False)
    assert (tower.placed, tower.next) == (["box0"], "box1")
    np.testing.assert_array_equal(tower.place, [0.0, 0.0, 3 * HALF])
    assert tower.others == ["box0"]


def test_a_tower_that_stands_has_no_next_box() -> None:
    tower = Tower(_BOXES)
    tower.update(_data([(0.0, HALF), (0.0, 3 * HALF)]), False)
    assert tower.next is None
    assert tower.placed == _BOXES


def test_a_box_that_is_held_stays_the_next_one_and_one_at_which_the_hand_failed_does_not() -> None:
    tower = Tower(_BOXES)
    tower.update(_data([(0.3, HALF), (0.2, HALF)]), False)
    tower.update(_data([(0.1, HALF), (0.35, HALF)]), True)
    assert tower.next == "box1"
    tower.shunned = "box1"
    tower.update(_data([(0.3, HALF), (0.2, HALF)]), False)
    assert tower.next == "box0"
