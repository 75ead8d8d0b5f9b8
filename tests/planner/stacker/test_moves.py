"""Plans that fetch a box, part it from others, and carry it."""

from typing import Any

import numpy as np

from limberjack.planner.arm.hand import CLOSED, OPEN
from limberjack.planner.arm.kinematics import GRASP, hand_places
from limberjack.planner.stacker.box_grip import HIGH, PRESS
from limberjack.planner.stacker.boxes import HALF
from limberjack.planner.stacker.moves import OVER, UNDER_HAND, Moves
from limberjack.planner.stacker.stack import Stack
from limberjack.planner.stacker.tower import Tower

from .scenes import DOWN, TOP, place_boxes, point_hand, scene

_CLOSE = 1e-9  # metres and radians; closed forms there and back round by 1e-16
_WIDTH = 2 * HALF


def _moves(physics: Any, boxes: int, next_box: str | None = None) -> Moves:
    """Moves for the next box of a scene, which the tower chooses by default."""
    names = [f"box{number}" for number in range(boxes)]
    tower = Tower(names)
    tower.update(physics.named.data, False)
    if next_box is not None:
        tower.next, tower.waiting = next_box, [name for name in names if name != next_box]
    return Moves(Stack.settings, tower, physics.named.data)


def _random() -> np.random.Generator:
    return np.random.default_rng(0)


def _ends(plans: np.ndarray) -> np.ndarray:
    """Places of the grasp site at the last knots, (n, 2), metres."""
    return hand_places(plans[:, -1, :4], GRASP)


def _tilts(plans: np.ndarray) -> np.ndarray:
    """Angles between the hand and straight down at the last knots, (n,), radians."""
    return np.arccos(np.cos(plans[:, -1, :4].sum(axis=-1) - DOWN))


def test_the_hand_comes_to_the_box_from_above_and_closes_there() -> None:
    _, physics = scene([(0.3, HALF), (0.1, HALF)])
    plans = _moves(physics, 2).reaching(_random())
    at_box = np.abs(_ends(plans) - [0.1, HALF + HIGH]).max(axis=-1) < _CLOSE
    assert at_box.any()
    assert (plans[at_box][:, -1, 4] == CLOSED).all()
    assert (plans[at_box][:, 0, 4] < CLOSED).all()
    assert (_tilts(plans[at_box]) < 0.4 + _CLOSE).all()
    above = np.abs(_ends(plans) - [0.1, HALF + 0.09]).max(axis=-1) < _CLOSE
    assert (plans[above][:, -1, 4] < CLOSED).all()


def test_a_hand_at_the_box_closes_at_once() -> None:
    _, physics = scene([(0.3, HALF), (0.1, HALF)])
    point_hand(physics, 0.1, HALF + HIGH)
    plans = _moves(physics, 2).reaching(_random())
    assert (plans[:, 0, 4] == CLOSED).any()


def test_the_hand_passes_over_boxes_that_stand_in_between() -> None:
    _, physics = scene([(0.05, HALF), (0.2, HALF), (0.2, TOP), (0.2, TOP + _WIDTH)], target=0.0)
    point_hand(physics, 0.33, 0.1)
    plans = _moves(physics, 4).reaching(_random())
    places = hand_places(plans[..., :4], GRASP)
    crossing = (places[:, 0, 0] > 0.2) & (places[:, -1, 0] < 0.1)
    over = np.where(np.abs(places[..., 0] - 0.2) < HALF, places[..., 1], np.inf).min(axis=-1)
    needed = 6 * HALF + UNDER_HAND - _CLOSE
    assert (crossing & np.isfinite(over) & (over > needed)).any()


def test_a_box_with_no_room_beside_it_is_turned_away_from_its_neighbour() -> None:
    for side in (1.0, -1.0):
        _, physics = scene([(0.1 - side * 1.1 * _WIDTH, HALF), (0.1, HALF)], target=0.1 + side)
        crowded = _moves(physics, 2)
        assert crowded._tower.next == "box1"
        plans = crowded.reaching(_random())
        place_boxes(physics, [(0.1 - side * 0.3, HALF)])
        alone = _moves(physics, 2).reaching(_random())
        turning = plans[: len(plans) - len(alone)]
        assert len(turning) >= 3
        hands = hand_places(turning[..., :4], GRASP)[..., 0]
        assert (side * (hands[:, -1] - hands[:, 2]) > 0).all()


def test_a_box_between_two_others_is_not_turned() -> None:
    apart, close = 3 * _WIDTH, 1.1 * _WIDTH
    counts = []
    for gap in (apart, close):
        _, physics = scene([(0.1 - gap, HALF), (0.1, HALF), (0.1 + gap, HALF), (-0.3, HALF)])
        moves = _moves(physics, 4, "box1")
        counts.append(len(moves.reaching(_random())))
    assert counts[0] == counts[1]


def test_a_hand_with_another_box_between_its_fingers_also_backs_off() -> None:
    _, physics = scene([(0.3, HALF), (0.1, HALF)])
    point_hand(physics, 0.3, HALF + HIGH)
    plans = _moves(physics, 2).reaching(_random())
    heights = hand_places(plans[..., :4], GRASP)[..., 1]
    opened = (plans[:, :2, 4] == OPEN).all(axis=-1)
    assert opened.any()
    assert heights[opened].max() > HALF + HIGH + 0.05


def _carried(x: float, place: float) -> tuple[np.ndarray, np.ndarray]:
    """Plans for a box held at x that belongs onto one at `place`, and paths of its middle."""
    _, physics = scene([(x, 0.1), (place, HALF)], target=place)
    point_hand(physics, x, 0.1 + HIGH, np.radians(24.0))
    plans = _moves(physics, 2).carrying(_random())
    return plans, hand_places(plans[..., :4], GRASP + HIGH)


def test_a_box_near_its_place_is_put_down_there_or_held_above_it() -> None:
    plans, paths = _carried(0.08, 0.0)
    down = np.abs(paths[:, -1] - [0.0, TOP]).max(axis=-1) < _CLOSE
    above = np.abs(paths[:, -1] - [0.0, TOP + OVER]).max(axis=-1) < _CLOSE
    assert down.any()
    assert above.any()
    assert set(plans[down][:, -1, 4].tolist()) == {OPEN}
    assert set(plans[above][:, -1, 4].tolist()) == {PRESS}
    assert (plans[:, 0, 4] == PRESS).all()
    assert (_tilts(plans[down]) < 0.4 + _CLOSE).all()


def test_a_box_far_from_its_place_first_goes_beside_it_and_is_not_let_go() -> None:
    plans, paths = _carried(0.3, 0.0)
    assert (plans[..., 4] == PRESS).all()
    assert (paths[:, -1, 0] > 0.13 - _CLOSE).all()
    beside = np.abs(paths[:, -1, 0] - 0.13) < _CLOSE
    assert beside.any()
    assert (paths[beside][:, -1, 1] > 3.5 * HALF).all()


def test_a_carried_box_passes_over_boxes_that_stand_in_between() -> None:
    tower = [(0.06, HALF), (0.06, TOP), (0.06, TOP + _WIDTH)]
    _, physics = scene([(0.12, 0.2), *tower], level=0)
    point_hand(physics, 0.12, 0.2 + HIGH, np.radians(24.0))
    moves = _moves(physics, 4, "box0")
    paths = hand_places(moves.carrying(_random())[..., :4], GRASP + HIGH)
    over = paths[np.abs(paths[..., 0] - 0.06) < HALF]
    assert len(over)
    assert (over[:, 1] > 7.5 * HALF - _CLOSE).any()
