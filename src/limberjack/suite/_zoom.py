"""`zoom`: a square grid resampled to more points with cubic splines.

    heights = zoom(bumps, 201)      # (30, 30) -> (201, 201), float64

It computes what `scipy.ndimage.zoom` does by default (order 3, prefilter, mode 'constant'), with
the same order of operations, and so spares the package a dependency. The filter comes from Unser,
"Splines: A perfect fit for signal and image processing" (1999), with mirrored edges.
"""

import numpy as np

__all__ = ["zoom"]

# Pole of the recursive filter of cubic splines, sqrt(3) - 2 without the error of the subtraction.
_POLE = -1.0 / (np.sqrt(3.0) + 2.0)
_GAIN = (1.0 - _POLE) * (1.0 - 1.0 / _POLE)


def zoom(grid: np.ndarray, size: int) -> np.ndarray:
    """The grid, (n, n), at `size` equally spaced points along each side, corner to corner.

    Args:
      grid: values, at least 3 along each side.
      size: number of points along each side of the result.
    """
    coefficients = _coefficients(_coefficients(np.array(grid, float)).T).T
    count = len(grid)
    positions = np.arange(size) * ((count - 1) / (size - 1))
    knots, weights = _neighbours(positions, count)
    zoomed = np.zeros((size, size))
    for row, row_weight in zip(knots, weights, strict=True):
        along = coefficients[row] * row_weight[:, None]
        for column, column_weight in zip(knots, weights, strict=True):
            zoomed += along[:, column] * column_weight
    return zoomed


def _coefficients(values: np.ndarray) -> np.ndarray:
    """The splines' coefficients along the first axis, (n, k) -> (n, k)."""
    c, z, n = values * _GAIN, _POLE, len(values)
    z_far, power = z ** (n - 1), z
    c[0] += z_far * c[-1]
    for i in range(1, n - 1):
        c[0] += power * (c[i] + z_far * c[n - 1 - i])
        power *= z
    c[0] /= 1 - z_far * z_far
    for i in range(1, n):
        c[i] += z * c[i - 1]
    c[-1] = (z * c[-2] + c[-1]) * z / (z * z - 1)
    for i in range(n - 2, -1, -1):
        c[i] = z * (c[i + 1] - c[i])
    return c


def _neighbours(positions: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers and weights of the four knots about each position, (4, size) each."""
    first = np.floor(positions).astype(int)
    x = positions - first
    z = 1.0 - x
    weights = [
        z * z * z / 6.0,
        (x * x * (x - 2.0) * 3.0 + 4.0) / 6.0,
        (z * z * (z - 2.0) * 3.0 + 4.0) / 6.0,
    ]
    weights.append(1.0 - weights[0] - weights[1] - weights[2])
    knots = abs(first - 1 + np.arange(4)[:, None])  # mirrored at both edges
    return count - 1 - abs(count - 1 - knots), np.array(weights)
