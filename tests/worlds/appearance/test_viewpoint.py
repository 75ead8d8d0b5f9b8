"""Tests of limberjack.worlds.appearance.viewpoint."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from limberjack.worlds.appearance.viewpoint import (
    CameraWalk,
    Pose,
    Sphere,
    distracted,
    rotation,
    shift,
    sphere_of,
    turned,
)

_FRONT = Sphere(4.0, -np.pi / 2, 1.3)  # as the cameras of cartpole and walker
_ABOVE = Sphere(0.75, 0.0, 0.0)  # as that of the reacher


def _walk(seed: int, start: Sphere, scale: float, is_moving: bool = False) -> CameraWalk:
    return CameraWalk(np.random.RandomState(seed), start, scale, is_moving)


def _axes(direction: np.ndarray) -> np.ndarray:
    right = np.cross(direction, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, direction), -direction], axis=-1)


@pytest.mark.parametrize("scale", [0.1, 0.3])
def test_a_camera_fills_the_published_ranges(scale: float) -> None:
    drawn = [_walk(seed, _FRONT, scale).at(0) for seed in range(1000)]
    places, rolls = np.array([place for place, _ in drawn]), np.array([roll for _, roll in drawn])
    turn = np.pi / 2 * scale
    low = [4 * (1 - 0.5 * scale), -np.pi / 2 - turn, 1.3 - turn]
    high = [4 * (1 + 1.5 * scale), -np.pi / 2 + turn, min(1.3 + turn, np.pi / 2)]
    assert (places >= np.subtract(low, 1e-12)).all()
    assert (places <= np.add(high, 1e-12)).all()
    # 1000 uniform draws come within 1 % of both ends.
    assert_allclose(places.min(axis=0), low, atol=0.01 * np.subtract(high, low).max())
    assert_allclose(places.max(axis=0), high, atol=0.01 * np.subtract(high, low).max())
    # The same 1 %: the range is twice as wide as its bound.
    assert_allclose([rolls.min(), rolls.max()], [-turn, turn], atol=0.02 * turn)


def test_a_camera_in_front_stays_in_its_quadrant_and_one_above_does_not() -> None:
    for seed in range(200):
        place, _ = _walk(seed, _FRONT, 1.0).at(0)
        assert -np.pi - 1e-12 <= place.horizontal <= 1e-12
        assert -1e-12 <= place.vertical <= np.pi / 2 + 1e-12
    above = [_walk(seed, _ABOVE, 1.0).at(0)[0] for seed in range(200)]
    assert max(place.horizontal for place in above) > 0.5
    # As in DCS, the first picture is taken after a change, which turns negative angles around.
    assert min(place.vertical for place in above) >= 0.0


def test_a_fixed_camera_stays_and_a_moving_one_keeps_to_the_greatest_speed() -> None:
    fixed, moving = _walk(0, _FRONT, 0.3), _walk(0, _FRONT, 0.3, is_moving=True)
    first = fixed.at(0)
    assert fixed.at(40) == first
    before = moving.at(0)
    rolls = []
    for changes in range(1, 40):
        now = moving.at(changes)
        # The start is 4 metres away, for which the speed is given.
        assert np.linalg.norm(now[0].vector - before[0].vector) <= 0.4 * 0.3 + 1e-9
        rolls.append(abs(now[1] - before[1]))
        assert now != before
        before = now
    assert max(rolls) <= np.pi / 50 * 0.3 + 1e-12


def test_speeds_are_those_of_the_distance_of_the_start() -> None:
    near = Sphere(0.4, *_FRONT[1:])
    walk = _walk(0, near, 0.3, is_moving=True)
    before = walk.at(1)[0].vector  # the first velocity is not scaled, as in the original
    after = walk.at(2)[0].vector
    assert np.linalg.norm(after - before) <= 0.4 * 0.3 * 0.1 + 1e-9


def test_a_walk_does_not_depend_on_when_it_is_asked() -> None:
    step_by_step = _walk(1, _FRONT, 0.2, is_moving=True)
    for changes in range(6):
        step_by_step.at(changes)
    assert step_by_step.at(6) == _walk(1, _FRONT, 0.2, is_moving=True).at(6)


@pytest.mark.parametrize("start", [_FRONT, Sphere(2.0, 2.0, 0.7), _ABOVE])
def test_a_moved_camera_looks_at_the_same_point(start: Sphere) -> None:
    centre, lookat = np.array([1.0, 0.5, 0.2]), np.array([1.1, 0.4, 0.3])
    position = centre + start.vector
    direction = (lookat - position) / np.linalg.norm(lookat - position)
    pose = Pose(position, _axes(direction))
    place = Sphere(start.radius * 1.2, start.horizontal + 0.2, start.vertical + 0.1)
    moved = distracted(pose, place, 0.0, start, centre, lookat)
    assert_allclose(np.linalg.norm(moved.position - centre), 1.2 * start.radius)
    # 1e-12: entries of 0 and 1 are sums of a few products, each rounded.
    new = (lookat - moved.position) / np.linalg.norm(lookat - moved.position)
    assert_allclose(-moved.axes[:, 2], new, atol=1e-12)
    assert_allclose(moved.axes.T @ moved.axes, np.eye(3), atol=1e-12)
    assert_allclose(np.linalg.det(moved.axes), 1.0)
    if start.is_above:
        assert_allclose(moved.axes[2, 0], 0.0, atol=1e-12)  # a level horizon


def test_a_roll_turns_the_picture_only() -> None:
    pose = Pose(_FRONT.vector, _axes(-_FRONT.vector / 4.0))
    level = distracted(pose, _FRONT, 0.0, _FRONT, np.zeros(3), np.zeros(3))
    rolled = distracted(pose, _FRONT, 0.3, _FRONT, np.zeros(3), np.zeros(3))
    assert_allclose(rolled.axes[:, 2], level.axes[:, 2])
    assert_allclose(rolled.axes[:, 0] @ level.axes[:, 0], np.cos(0.3))


def test_a_camera_that_looks_back_is_turned_half_around() -> None:
    pose = Pose(np.array([0.0, 0.0, 1.0]), np.eye(3))
    place = Sphere(1.0, 0.0, np.pi)
    moved = distracted(pose, place, 0.0, Sphere(1.0, 0.0, 0.0), np.zeros(3), np.zeros(3))
    np.testing.assert_array_equal(moved.axes, np.diag([-1.0, 1.0, -1.0]))


def test_the_place_on_a_sphere_is_that_of_its_vector() -> None:
    place = Sphere(2.0, -1.0, 0.8)
    assert_allclose(sphere_of(place.vector), place)


def test_rotations_are_even_angles_within_the_limit() -> None:
    drawn = [rotation(np.random.RandomState(seed), 90.0) for seed in range(500)]
    angles = np.degrees([np.arctan2(one[1, 0], one[0, 0]) for one in drawn])
    assert angles.min() >= -90.0 - 1e-9
    assert angles.max() <= 88.2 + 1e-9  # the hundred angles lack the last one, as in DMC-GB2
    assert len(set(angles.round(6))) > 90
    for one in drawn[:5]:
        assert_allclose(one[2], [0, 0, 1])


@pytest.mark.parametrize(
    ("name", "side", "up", "down"),
    [
        ("planar walker", 10, 10, 10),
        ("cheetah", 10, 10, 10),
        ("cart-pole", 8, 10, 10),
        ("finger", 6, 12, 6),
        ("ball in cup", 6, 12, 6),
        ("humanoid", 10, 10, 10),
    ],
)
@pytest.mark.parametrize("scale", [1.0, 1 / 1.5])
def test_shifts_lie_on_the_border_of_the_published_rectangle(
    name: str, side: float, up: float, down: float, scale: float
) -> None:
    turns = [shift(np.random.RandomState(seed), name, scale) for seed in range(400)]
    # The second axis' angle first, then the first axis': Ry @ Rx.
    pitch = np.degrees([np.arctan2(-one[2, 0], one[0, 0]) for one in turns]) / scale
    roll = np.degrees([np.arctan2(-one[1, 2], one[1, 1]) for one in turns]) / scale
    on_side = np.isclose(np.abs(pitch), side)
    on_end = np.isclose(roll, up) | np.isclose(roll, -down)
    assert (on_side | on_end).all()
    assert_allclose([pitch.min(), pitch.max()], [-side, side])
    assert_allclose([roll.min(), roll.max()], [-down, up])


def test_a_pose_is_turned_about_its_own_axes() -> None:
    axes = _axes(np.array([0.0, 1.0, 0.0]))
    turn = rotation(np.random.RandomState(0), 90.0)
    new = turned(Pose(np.ones(3), axes), turn)
    assert_allclose(new.position, 1.0)
    assert_allclose(new.axes, axes @ turn)
