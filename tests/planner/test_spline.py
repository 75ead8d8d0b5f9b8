"""Piecewise linear splines."""

import numpy as np

from limberjack.planner.spline import knot_weights, targets_at


def test_a_spline_passes_its_knots_and_is_straight_between_them() -> None:
    knots = np.array([[0.0, 1.0], [2.0, 1.0], [3.0, -1.0]])
    np.testing.assert_array_equal(targets_at(knots, 0.0), knots[0])
    np.testing.assert_array_equal(targets_at(knots, 1.0), knots[1])
    np.testing.assert_array_equal(targets_at(knots, 2.0), knots[2])
    np.testing.assert_allclose(targets_at(knots, 1.25), [2.25, 0.5])
    np.testing.assert_array_equal(targets_at(knots, 7.0), knots[2])


def test_a_row_of_many_splines_is_that_spline() -> None:
    knots = np.random.default_rng(0).normal(size=(6, 4, 3))
    for place in (0.0, 0.3, 2.9, 3.0):
        rows = targets_at(knots, place)
        for row in range(6):
            np.testing.assert_array_equal(rows[row], targets_at(knots[row], place))


def test_shares_of_knots_make_the_splines_values() -> None:
    knots = np.random.default_rng(0).normal(size=(6, 4, 3))
    places = np.array([0.0, 0.3, 1.0, 2.9, 3.0, 7.0])
    found = knot_weights(4, places) @ knots
    # Sums of products, of which all but two are 0: they round.
    np.testing.assert_allclose(found.swapaxes(0, 1), targets_at(knots, places), atol=1e-15)
