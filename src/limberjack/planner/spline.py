"""Piecewise linear splines of targets, which plans are.

    targets = targets_at(knots, 0.3)           # (K, nu) -> (nu,)
    weights = knot_weights(5, phases)          # (len(phases), 5); weights @ knots are the targets

A phase counts knots from the spline's first one. Beyond the last knot its value holds.
"""

import numpy as np

__all__ = ["knot_weights", "targets_at"]


def targets_at(knots: np.ndarray, places: float | np.ndarray) -> np.ndarray:
    """A piecewise linear spline's values, (..., K, nu) -> (places, ..., nu).

    Args:
      knots: targets at the places 0, 1, ... K-1.
      places: one or an array of them; beyond the last knot its value holds.
    """
    last = knots.shape[-2] - 1
    places = np.minimum(np.maximum(np.asarray(places, float), 0.0), float(last))
    left = np.minimum(places.astype(int), last - 1)
    part = (places - left).reshape(places.shape + (1,) * (knots.ndim - 1))
    by_knot = np.moveaxis(knots, -2, 0)
    return (1.0 - part) * by_knot[left] + part * by_knot[left + 1]


def knot_weights(count: int, places: np.ndarray) -> np.ndarray:
    """Weights of each of `count` knots at phases of a spline, (len(places), count).

    Times knots, (..., count, nu), these are the spline's values there, (..., len(places), nu).
    """
    return targets_at(np.eye(count), places)
