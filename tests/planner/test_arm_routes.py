"""Routes of the planar arm between floor and walls."""

import itertools

import numpy as np

from limberjack.planner.arm_routes import routes
from limberjack.planner.planar_ik import GRASP, hand_places, hand_poses, is_clear

_REACH = 0.178


def _goals(point: tuple[float, float], angle: float) -> np.ndarray:
    random = np.random.default_rng(1)
    return hand_poses(random, np.array(point), GRASP, np.zeros(4), 12, angle, 0.1)


def test_all_of_a_route_is_clear_and_it_ends_at_a_goal() -> None:
    now = hand_poses(np.random.default_rng(0), np.array([0.2, 0.15]), GRASP, np.zeros(4), 1)[0]
    goals = _goals((-0.2, 0.2), 1.5)
    found = routes(np.random.default_rng(2), now, goals, _REACH)
    assert 0 < len(found) <= 6
    lengths = []
    for route in found:
        stations = np.stack([now, *route.stations])
        for start, end in itertools.pairwise(stations):
            line = start + np.arange(1, 7)[:, None] / 6 * (end - start)
            assert is_clear(line, _REACH).all()
        ends = np.array([hand_places(goal, GRASP) for goal in goals])
        place = hand_places(route.stations[-1], GRASP)
        assert np.abs(ends - place).max(axis=-1).min() < 1e-9
        lengths.append(np.abs(np.diff(stations, axis=0)).max(axis=-1).sum())
        np.testing.assert_allclose(route.rest, lengths[-1] - np.abs(stations[1] - now).max())
    assert lengths == sorted(lengths)


def test_there_is_no_route_to_nowhere_nor_through_the_floor() -> None:
    assert routes(np.random.default_rng(0), np.zeros(4), np.zeros((0, 4)), _REACH) == []
    under = np.array([[np.pi, 0.0, 0.0, 0.0]])
    assert routes(np.random.default_rng(0), np.zeros(4), under, _REACH) == []
