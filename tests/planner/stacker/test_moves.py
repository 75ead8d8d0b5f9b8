"""Plans that fetch a box, part it from others, and carry it, and where the arm retreats to."""

from typing import Any

import numpy as np

from limberjack import suite
from limberjack.planner.arm.hand import CLOSED, OPEN
from limberjack.planner.arm.kinematics import GRASP, hand_places, hand_poses
from limberjack.planner.stacker.box_grip import HIGH, PRESS
from limberjack.planner.stacker.moves import (
    OVER,
    STACKING,
    UNDER_HAND,
    carrying,
    later,
    plans_over,
    reaching,
    refuge,
    shelter,
    turning_over,
)
from limberjack.planner.stacker.tower import HALF, Tower

from .scenes import DOWN, TOP, place_boxes, point_hand, scene

_CLOSE = 1e-9  # metres and radians; closed forms there and back round by 1e-16
_WIDTH = 2 * HALF


def _tower(physics: Any, boxes: int, next_box: str | None = None) -> Tower:
    """The tower of a scene, which chooses the next box by default."""
    tower = Tower([f"box{number}" for number in range(boxes)])
    tower.update(physics.named.data, False)
    tower.next = next_box or tower.next
    return tower


def _reaching(physics: Any, boxes: int, next_box: str | None = None) -> np.ndarray:
    return reaching(_tower(physics, boxes, next_box), physics.named.data, _random())


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
    plans = _reaching(physics, 2)
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
    plans = _reaching(physics, 2)
    assert (plans[:, 0, 4] == CLOSED).any()


def test_the_hand_passes_over_boxes_that_stand_in_between() -> None:
    _, physics = scene([(0.05, HALF), (0.2, HALF), (0.2, TOP), (0.2, TOP + _WIDTH)], target=0.0)
    point_hand(physics, 0.33, 0.1)
    plans = _reaching(physics, 4)
    places = hand_places(plans[..., :4], GRASP)
    crossing = (places[:, 0, 0] > 0.2) & (places[:, -1, 0] < 0.1)
    over = np.where(np.abs(places[..., 0] - 0.2) < HALF, places[..., 1], np.inf).min(axis=-1)
    needed = 6 * HALF + UNDER_HAND - _CLOSE
    assert (crossing & np.isfinite(over) & (over > needed)).any()


def test_a_box_with_no_room_beside_it_is_turned_away_from_its_neighbour() -> None:
    for side in (1.0, -1.0):
        _, physics = scene([(0.1 - side * 1.1 * _WIDTH, HALF), (0.1, HALF)], target=0.1 + side)
        assert _tower(physics, 2).next == "box1"
        plans = _reaching(physics, 2)
        place_boxes(physics, [(0.1 - side * 0.3, HALF)])
        alone = _reaching(physics, 2)
        turning = plans[: len(plans) - len(alone)]
        assert len(turning) >= 3
        hands = hand_places(turning[..., :4], GRASP)[..., 0]
        assert (side * (hands[:, -1] - hands[:, 2]) > 0).all()


def test_a_box_between_two_others_is_not_turned() -> None:
    apart, close = 3 * _WIDTH, 1.1 * _WIDTH
    counts = []
    for gap in (apart, close):
        _, physics = scene([(0.1 - gap, HALF), (0.1, HALF), (0.1 + gap, HALF), (-0.3, HALF)])
        counts.append(len(_reaching(physics, 4, "box1")))
    assert counts[0] == counts[1]


def test_a_hand_with_another_box_between_its_fingers_also_backs_off() -> None:
    _, physics = scene([(0.3, HALF), (0.1, HALF)])
    point_hand(physics, 0.3, HALF + HIGH)
    plans = _reaching(physics, 2)
    heights = hand_places(plans[..., :4], GRASP)[..., 1]
    opened = (plans[:, :2, 4] == OPEN).all(axis=-1)
    assert opened.any()
    assert heights[opened].max() > HALF + HIGH + 0.05


def _carried(x: float, place: float) -> tuple[np.ndarray, np.ndarray]:
    """Plans for a box held at x that belongs onto one at `place`, and paths of its middle."""
    _, physics = scene([(x, 0.1), (place, HALF)], target=place)
    point_hand(physics, x, 0.1 + HIGH, np.radians(24.0))
    plans = carrying(_tower(physics, 2), physics.named.data, _random())
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


def test_a_box_far_from_its_place_on_the_floor_goes_straight_there() -> None:
    _, physics = scene([(0.3, 0.1), (-0.3, HALF)], level=0)
    point_hand(physics, 0.3, 0.1 + HIGH, np.radians(24.0))
    plans = carrying(_tower(physics, 2, "box0"), physics.named.data, _random())
    ends = hand_places(plans[:, -1, :4], GRASP + HIGH)
    down = np.abs(ends - [0.0, HALF]).max(axis=-1) < _CLOSE
    assert down.any()
    assert set(plans[down][:, -1, 4].tolist()) == {OPEN}


def test_a_carried_box_passes_over_boxes_that_stand_in_between() -> None:
    tower = [(0.06, HALF), (0.06, TOP), (0.06, TOP + _WIDTH)]
    _, physics = scene([(0.12, 0.2), *tower], level=0)
    point_hand(physics, 0.12, 0.2 + HIGH, np.radians(24.0))
    plans = carrying(_tower(physics, 4, "box0"), physics.named.data, _random())
    paths = hand_places(plans[..., :4], GRASP + HIGH)
    over = paths[np.abs(paths[..., 0] - 0.06) < HALF]
    assert len(over)
    assert (over[:, 1] > 7.5 * HALF - _CLOSE).any()


def _poses(x: float, z: float, count: int) -> np.ndarray:
    found = hand_poses(
        np.random.default_rng(0), np.array([x, z]), GRASP, np.zeros(4), count, DOWN, 0.2
    )
    assert len(found) == count
    return found


def test_a_way_over_goes_up_first_and_comes_down_at_its_end() -> None:
    now, ends = _poses(0.25, 0.1, 1)[0], _poses(0.05, 0.08, 3)
    cruise = 0.2
    ways = plans_over(now, ends, cruise, GRASP, 0.0, [OPEN, CLOSED])
    assert ways.shape[1:] == (STACKING.knots, 5)
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
    both = plans_over(now, ends, 0.2, GRASP, 0.0, grasps)
    parts = [
        plans_over(now, end[None], 0.2, GRASP, 0.0, grasp)
        for end, grasp in zip(ends, grasps, strict=True)
    ]
    expected = np.concatenate([*(ways[:-1] for ways in parts), *(ways[-1:] for ways in parts)])
    np.testing.assert_array_equal(both, expected)


def test_later_ways_open_the_hand_first() -> None:
    ways = plans_over(np.zeros(4), _poses(0.1, 0.2, 2), 0.2, GRASP, 0.0, [CLOSED, CLOSED])
    delayed = later(ways)
    knots = int((delayed[0, :, 4] == OPEN).sum())
    assert knots >= 1
    np.testing.assert_array_equal(delayed[:, knots:], ways[:, :-knots])
    np.testing.assert_array_equal(delayed[:, :knots, :4], np.repeat(ways[:, :1, :4], knots, axis=1))


def test_a_fingertip_that_turns_a_box_over_moves_to_the_side_that_it_is_told() -> None:
    now, box = _poses(0.1, 0.3, 1)[0], np.array([0.15, 0.022])
    for side in (1.0, -1.0):
        ways = turning_over(now, box, side, _random())
        assert len(ways) >= 3
        hands = hand_places(ways[..., :4], GRASP)[..., 0]
        assert (side * (hands[:, -1] - hands[:, 2]) > 0).all()


def test_a_refuge_is_the_same_at_the_same_try_with_the_hand_above_the_ground() -> None:
    env = suite.load("stacker", "stack_2", {"random": 1})
    env.reset()
    data = env.physics.named.data
    place = np.array([-0.3, 0.0, 0.022])
    first, again, other = (refuge(data, place, tries) for tries in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    for joints in (first, other):
        hand = hand_places(joints, GRASP)
        # Solved in closed form, whose sines and cosines round.
        np.testing.assert_allclose(hand, [-0.25, 0.25], rtol=0, atol=1e-12)


def test_the_shelter_is_beside_where_boxes_fall() -> None:
    env = suite.load("stacker", "stack_2", {"random": 1})
    env.reset()
    joints = shelter(env.physics.named.data)
    assert joints.shape == (4,)
    for reach in (-0.12, 0.0, GRASP):  # elbow, wrist and hand
        link = joints if reach >= 0 else np.append(joints[:3], 0.0)
        assert hand_places(link, reach)[0] < 0.08
