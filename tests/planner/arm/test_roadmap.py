"""Paths of the planar arm around obstacles."""

import numpy as np
import pytest

from limberjack.planner.arm import roadmap
from limberjack.planner.arm.collision import Obstacle, clearance
from limberjack.planner.arm.kinematics import GRASP, hand_places, hand_poses
from limberjack.planner.arm.roadmap import find_path

_HELD = GRASP + 0.022  # metres
_START = np.array([1.2, 0.8, 0.6, 0.4])
_BEAM = Obstacle(np.array([[[0.0, 0.6], [0.0, 0.8]]]), np.array([0.01]))  # above the arm


def _goals() -> np.ndarray:
    """Poses of the hand on the other side of the beam."""
    random = np.random.default_rng(0)
    return hand_poses(random, np.array([0.3, 0.4]), GRASP, -_START, 24)


def test_a_path_leads_to_a_goal_around_the_obstacle() -> None:
    goals = _goals()
    path = find_path(_START, goals, _HELD, _BEAM)
    assert path is not None
    assert not path.is_straight
    poses = np.array([_START, *path.next_points(1)])
    assert (clearance(poses, _HELD, _BEAM) > 0.0).all()
    gaps = (poses[-1] - goals + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(gaps).sum(axis=-1).min() < 1e-9


def test_what_is_left_of_a_path_falls_as_it_is_gone() -> None:
    path = find_path(_START, _goals(), _HELD, _BEAM)
    assert path is not None
    left = []
    for pose in path.next_points(1):
        path.advance(pose)
        left.append(float(path.remaining(pose[None])[0]))
    assert (np.diff(left) <= 1e-9).all()
    assert left[-1] == 0.0


def test_there_is_no_path_to_a_goal_within_the_obstacle() -> None:
    around = Obstacle(np.array([[[0.3, 0.35], [0.3, 0.45]]]), np.array([0.2]))
    assert find_path(_START, _goals(), _HELD, around) is None


def test_a_path_that_begins_within_the_obstacle_leaves_it_and_does_not_go_through_it() -> None:
    hand = hand_places(_START, GRASP)
    ends = hand + np.array([[0.0, -0.02], [0.0, 0.02]])
    walls = np.concatenate([_BEAM.ends, ends[None]])
    both = Obstacle(walls, np.array([0.01, 0.01]))
    assert clearance(_START[None], _HELD, both)[0, 0] < -0.01
    path = find_path(_START, _goals(), _HELD, both)
    assert path is not None
    poses = np.array(path.next_points(1))
    away = np.abs(poses - _START).sum(axis=-1)
    assert (clearance(poses[away > 1.5], _HELD, both)[:, 0] > 0.0).all()


def test_the_short_cut_to_the_end_of_a_path_counts_no_less_than_the_way() -> None:
    beside = np.array([0.35, 0.2, 0.2, 0.2])  # the beam, which is between the hand and the goal
    path = find_path(beside, -beside[None], _HELD, _BEAM)
    assert path is not None
    poses = np.array([beside, *path.next_points(1)])
    length = np.abs(np.diff(poses, axis=0)).sum()
    assert length > 3.0 * np.abs(2.0 * beside).sum()
    assert path.remaining(beside[None])[0] > 0.8 * length


def test_a_goal_that_is_too_near_to_something_is_gone_to_on_request() -> None:
    goal = _goals()[0]
    tip = hand_places(goal, _HELD)
    ahead = (tip - hand_places(goal, GRASP)) / (_HELD - GRASP)
    place = tip + (0.005 + 0.01 + 0.005) * ahead  # radii of what is held and of the wall, a gap
    both = Obstacle(
        np.concatenate([_BEAM.ends, [[place, place + 0.001 * ahead]]]), np.array([0.01, 0.01])
    )
    assert 0.0 < clearance(goal[None], _HELD, both)[0, 0] < 0.008
    assert find_path(_START, goal[None], _HELD, both) is None
    assert find_path(_START, goal[None], _HELD, both, close=True) is not None


def test_a_path_does_not_jump_over_a_thin_wall() -> None:
    wall = Obstacle(np.array([[[0.3, 0.3], [0.42, 0.3]]]), np.array([0.004]))
    random = np.random.default_rng(0)
    above = hand_poses(random, np.array([0.36, 0.45]), GRASP, -_START, 1)[0]
    below = hand_poses(random, np.array([0.36, 0.15]), GRASP, above, 24)
    for held in (above, above + np.array([0.0, 0.0, 0.0, 0.3])):
        path = find_path(held, below, _HELD, wall)
        if path is None:
            continue
        poses = np.array([held, *path.next_points(1)])
        parts = np.linspace(0.0, 1.0, 10)[:, None, None]
        between = (poses[:-1] + parts * (poses[1:] - poses[:-1])).reshape(-1, 4)
        assert clearance(between, _HELD, wall)[:, 0].min() > 0.0


@pytest.fixture
def edges(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The edges that searches have asked for."""
    asked: list[tuple[int, int]] = []
    is_clear = roadmap._Search._is_clear

    def counted(self: roadmap._Search, before: int, node: int, queue: list[roadmap._Entry]) -> bool:
        asked.append((before, node))
        return is_clear(self, before, node, queue)

    monkeypatch.setattr(roadmap._Search, "_is_clear", counted)
    return asked


def test_a_search_stops_at_its_budget(edges: list[tuple[int, int]]) -> None:
    assert find_path(_START, _goals(), _HELD, _BEAM, budget=5) is None
    assert len(edges) == 4  # the start has no edge
    assert find_path(_START, _goals(), _HELD, _BEAM) is not None
    assert 4 < len(edges) - 4 <= 3000


def test_a_search_soon_stops_if_no_edge_leads_to_a_goal(
    edges: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    # The slot of insert_peg, and poses around a peg that lies beside it.
    walls = [[[-0.371, 0.163], [-0.37, 0.193]], [[-0.321, 0.161], [-0.32, 0.191]]]
    slot = Obstacle(np.array([*walls, [[-0.373, 0.123], [-0.323, 0.121]]]), np.full(3, 0.02))
    start = np.array([1.89, 1.0, -0.49, 0.51])
    goals = np.array(
        [[2.3, 0.35, -0.53, -0.06], [2.15, 0.48, -0.27, -0.32], [2.54, -0.44, 0.33, -0.41]]
    )
    assert find_path(start, goals, 0.085, slot, close=True) is None
    early = len(edges)
    monkeypatch.setattr(roadmap, "_EARLY", 10**6)  # never
    assert find_path(start, goals, 0.085, slot, close=True) is None
    assert early < 100 < 1000 < len(edges) - early


def test_edges_that_are_checked_together_give_the_path_of_single_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    together = find_path(_START, _goals(), _HELD, _BEAM)
    monkeypatch.setattr(roadmap, "_AT_ONCE", 1)
    alone = find_path(_START, _goals(), _HELD, _BEAM)
    assert together is not None
    assert alone is not None
    np.testing.assert_array_equal(together.waypoints, alone.waypoints)


def test_edges_are_free_together_as_they_are_alone() -> None:
    random = np.random.default_rng(0)
    begins = _START + random.uniform(-1.0, 1.0, (40, 4))
    turns = random.uniform(-1.5, 1.5, (40, 4)) * random.uniform(0.01, 1.0, (40, 1))
    far = np.full(4, -0.01)  # metres
    scene = roadmap._Scene(_HELD, _BEAM, _START, far, far)
    free = scene.are_edges_free(begins, turns)
    alone = [scene.is_edge_free(*edge) for edge in zip(begins, turns, strict=True)]
    assert 5 < free.sum() < 35
    np.testing.assert_array_equal(free, alone)
