"""The choice of the next box of a tower, and poses of boxes."""

from typing import Any

import numpy as np
import pytest

from limberjack.planner.stacker.tower import HALF, Tower, crest, lies_too_low, turned

from .scenes import TOP, place_boxes, scene

_BOXES = ["box0", "box1"]
_TOWER = np.array([[[0.0, HALF], [0.0, 3 * HALF]]])  # of two boxes
_ROUNDING = 1e-12  # of sums of a box's half, and of sines and cosines


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


def _lack(x: float, z: float) -> float:
    return float(lies_too_low(np.array([[x, z]]), _TOWER)[0])


def test_a_box_must_be_high_near_a_tower_and_off_the_floor_elsewhere() -> None:
    top = 4 * HALF
    assert _lack(0.08, HALF) == pytest.approx(top + 1.5 * HALF - HALF, rel=0, abs=_ROUNDING)
    assert _lack(0.08, top + 1.5 * HALF) == 0.0
    assert _lack(0.3, HALF) == pytest.approx(0.05 - HALF, rel=0, abs=_ROUNDING)
    assert _lack(0.3, 0.06) == 0.0


def test_turned_tells_a_box_on_its_edge_from_one_on_any_side() -> None:
    _, physics = scene([(0.1, HALF), (0.2, HALF)])
    found = []
    for angle in (0.0, np.pi / 2, np.pi / 4):
        place_boxes(physics, [(0.1, HALF)], angle)
        found.append(float(turned(physics.named.data, "box0")))
    np.testing.assert_allclose(found, [0.0, 0.0, 0.25], rtol=0, atol=_ROUNDING)


def test_the_crest_is_that_of_the_boxes_in_between() -> None:
    data = scene([(0.1, HALF), (0.1, TOP)])[1].named.data
    assert crest(data, ["box0", "box1"], 0.0, 0.3) == pytest.approx(4 * HALF, rel=0, abs=_ROUNDING)
    assert crest(data, ["box0"], 0.0, 0.3) == pytest.approx(2 * HALF, rel=0, abs=_ROUNDING)
    assert crest(data, ["box0", "box1"], -0.3, 0.0) == 0.0
