"""Piecewise linear splines of targets, which plans are.

    targets = targets_at(knots, 0.3)           # (K, nu) -> (nu,)
    weights = knot_weights(5, phases)          # (len(phases), 5); weights @ knots are the targets

A phase counts knots from the spline's first one. Beyond the last knot its value holds.
"""

import numpy as np

__all__ = ["knot_weights", "targets_at"]


def targets_at(knots: np.ndarray, phases: float | np.ndarray) -> np.ndarray:
    """A spline's values at one phase or an array of them, (..., K, nu) -> (phases, ..., nu)."""
    last = knots.shape[-2] - 1
    phases = np.minimum(np.maximum(np.asarray(phases, float), 0.0), float(last))
    left = np.minimum(phases.astype(int), last - 1)
    part = (phases - left).reshape(phases.shape + (1,) * (knots.ndim - 1))
    by_knot = np.moveaxis(knots, -2, 0)
    return (1.0 - part) * by_knot[left] + part * by_knot[left + 1]


def knot_weights(count: int, phases: np.ndarray) -> np.ndarray:
    """Weights of `count` knots at phases, (len(phases), count).

    Times knots, (..., count, nu), these are the values there, (..., len(phases), nu).
    """
    return targets_at(np.eye(count), phases)
