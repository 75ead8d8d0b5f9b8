"""Tests of limberjack.worlds.appearance.colors."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from limberjack.worlds.appearance.colors import (
    ColorWalk,
    palette,
    repainted_floor,
    repainted_sky,
)

_ORIGINAL = np.array([[0.05, 0.5, 0.95], [0.3, 0.4, 0.6]])


def _walk(seed: int, scale: float = 0.1, is_moving: bool = False) -> ColorWalk:
    return ColorWalk(np.random.RandomState(seed), _ORIGINAL, scale, is_moving)


def test_colours_fill_the_published_range_uniformly() -> None:
    drawn = np.array([_walk(seed).at(0) for seed in range(2000)])
    low, high = np.clip(_ORIGINAL - 0.1, 0, 1), np.clip(_ORIGINAL + 0.1, 0, 1)
    assert (drawn >= low).all()
    assert (drawn <= high).all()
    shares = (drawn - low) / (high - low)
    # 2000 uniform draws: four standard errors of the mean, and of the standard deviation.
    np.testing.assert_allclose(shares.mean(axis=0), 0.5, atol=4 * 0.289 / np.sqrt(2000))
    np.testing.assert_allclose(shares.std(axis=0), 12**-0.5, atol=0.016)


def test_fixed_colours_do_not_change() -> None:
    walk = _walk(0)
    first = walk.at(0).copy()
    assert_array_equal(walk.at(50), first)


def test_moving_colours_walk_with_the_published_steps_within_the_range() -> None:
    walks = [_walk(seed, 0.3, is_moving=True) for seed in range(300)]
    before = np.array([walk.at(3) for walk in walks])[:, 1]
    after = np.array([walk.at(4) for walk in walks])[:, 1]
    # 900 normal draws: four standard errors.
    np.testing.assert_allclose((after - before).std(), 0.03 * 0.3, rtol=0.1)
    late = walks[0].at(5000)
    assert (np.abs(late - _ORIGINAL) <= 0.3).all()
    assert not np.array_equal(late, after[0])


def test_a_walk_does_not_depend_on_when_it_is_asked() -> None:
    step_by_step = _walk(1, is_moving=True)
    for changes in range(8):
        step_by_step.at(changes)
    assert_array_equal(step_by_step.at(8), _walk(1, is_moving=True).at(8))


def test_a_palette_is_normal_around_the_suites_colours_and_the_floor_has_two() -> None:
    drawn = [palette(np.random.RandomState(seed), 0.1) for seed in range(1000)]
    body = np.array([one.body for one in drawn])
    # 1000 draws: four standard errors.
    np.testing.assert_allclose(body.mean(axis=0), (0.7, 0.5, 0.3), atol=4 * 0.1 / np.sqrt(1000))
    np.testing.assert_allclose(body.std(axis=0), 0.1, atol=0.01)
    for one in drawn:
        np.testing.assert_allclose(one.second_floor, one.floor + 0.1)
        assert all((color >= 0).all() and (color <= 1).all() for color in one[2:])


def test_a_floor_gets_two_colours_and_keeps_its_edge() -> None:
    board = np.zeros((8, 8, 3), np.uint8)
    board[:4, 4:] = board[4:, :4] = 200
    board[0] = board[-1] = board[:, 0] = board[:, -1] = 200
    before = board.copy()
    painted = repainted_floor(board, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert_array_equal(board, before)
    assert_array_equal(painted[2, 2], [255, 0, 0])
    assert_array_equal(painted[5, 5], [255, 0, 0])
    assert_array_equal(painted[2, 5], [0, 0, 255])
    assert_array_equal(painted[5, 2], [0, 0, 255])
    assert (painted[0] == 200).all()
    assert (painted[:, -1] == 200).all()


@pytest.mark.parametrize("side", [1, 2, 3])
def test_a_small_checkerboard_is_repainted_without_an_edge(side: int) -> None:
    board = np.full((side, side, 3), 50, np.uint8)
    board[0, side - 1] = board[side - 1, 0] = 200
    painted = repainted_floor(board, np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    assert_array_equal(painted[0, side - 1], [0, 0, 255])
    assert_array_equal((painted == [255, 0, 0]).all(axis=-1), (board == 50).all(axis=-1))


def test_a_sky_gets_another_colour_and_keeps_its_stars() -> None:
    sky = np.linspace([[102, 153, 204]], [[0, 0, 0]], 6).astype(np.uint8)
    sky[3] = 255
    painted = repainted_sky(sky, np.array([1.0, 0.5, 0.0]))
    assert_array_equal(painted[0, 0], [255, 128, 0])
    assert_array_equal(painted[3, 0], [255, 255, 255])
    assert_array_equal(painted[-1, 0], [0, 0, 0])
