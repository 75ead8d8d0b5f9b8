"""Tests of limberjack.suite._zoom."""

import numpy as np
import pytest

from limberjack.suite._zoom import zoom


@pytest.mark.parametrize(("count", "size"), [(30, 201), (30, 200), (7, 13), (4, 64)])
def test_the_points_are_scipys(count: int, size: int) -> None:
    ndimage = pytest.importorskip("scipy.ndimage")
    for seed in range(25):
        grid = np.random.RandomState(seed).uniform(0.15, 1, (count, count))
        expected, found = ndimage.zoom(grid, size / count), zoom(grid, size)
        assert found.dtype == expected.dtype
        # Compilers may fuse the multiplications and additions of SciPy, not those of NumPy.
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
        np.testing.assert_array_equal(found.astype(np.float32), expected.astype(np.float32))


def test_the_points_of_the_grid_are_among_those_of_the_result() -> None:
    grid = np.random.RandomState(0).uniform(size=(5, 5))
    np.testing.assert_allclose(zoom(grid, 13)[::3, ::3], grid, atol=1e-14)
    np.testing.assert_allclose(zoom(grid, 5), grid, atol=1e-14)


def test_a_slope_stays_a_slope_between_the_edges() -> None:
    slope = np.arange(30.0)[:, None] + 2 * np.arange(30.0)
    found = zoom(slope, 59)
    expected = (np.arange(59.0)[:, None] + 2 * np.arange(59.0)) / 2
    # Mirrored edges are felt less the farther away they are, by a factor of 0.27 for each point.
    np.testing.assert_allclose(found[24:-24, 24:-24], expected[24:-24, 24:-24], atol=1e-5)
    # The filter passes over the rows first.
    np.testing.assert_allclose(zoom(slope.T, 59), found.T, atol=1e-12)


def test_the_grid_is_left_alone() -> None:
    grid = np.random.RandomState(0).uniform(size=(4, 4))
    before = grid.copy()
    zoom(grid, 9)
    np.testing.assert_array_equal(grid, before)
