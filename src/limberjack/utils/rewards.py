"""Soft indicator functions: a score from 0 to 1 for how close a quantity is to an interval.

    tolerance(height, bounds=(1.4, inf), margin=0.35)      # one value per simulation
    tolerance(distance, bounds=(0, radius))                # a radius per simulation, (N,)
    mean_tolerance(controls, margin=1, sigmoid="quadratic")   # mean over the elements

`tolerance` is 1 inside the bounds; outside it decays along a sigmoid that reaches
`value_at_margin` at distance `margin`. The sigmoids and their order of operations are those of the
DeepMind Control Suite (Tassa et al. 2018, https://arxiv.org/abs/1801.00690), so rewards equal
dm_control's bit for bit.
"""

import functools
from collections.abc import Callable
from typing import Any, overload

import numpy as np

from limberjack.utils import arrays
from limberjack.utils.arrays import Quantity

__all__ = ["mean_tolerance", "tolerance"]

_DEFAULT_VALUE_AT_MARGIN = 0.1

# 0-d arrays, which NumPy does not have to convert on each use.
_ZERO = np.zeros(())
_ONE = np.ones(())
_NUMBERS = (float, int, np.generic)
_BOOLEANS = (bool, np.bool_)

# Any: a number or an array, distinguished by the type of a comparison's result; see the overloads.
_Bound = Any
_Curve = Callable[[Quantity, float], Quantity]


@overload
def tolerance(
    x: float,
    bounds: tuple[float, float] = ...,
    margin: float = ...,
    sigmoid: str = ...,
    value_at_margin: float = ...,
) -> float: ...


@overload
def tolerance(
    x: np.ndarray,
    bounds: tuple[Quantity, Quantity] = ...,
    margin: Quantity = ...,
    sigmoid: str = ...,
    value_at_margin: float = ...,
) -> np.ndarray: ...


@overload
def tolerance(
    x: Quantity,
    bounds: tuple[Quantity, Quantity] = ...,
    margin: Quantity = ...,
    sigmoid: str = ...,
    value_at_margin: float = ...,
) -> Quantity: ...


def tolerance(
    x: Quantity,
    bounds: tuple[_Bound, _Bound] = (0.0, 0.0),
    margin: _Bound = 0.0,
    sigmoid: str = "gaussian",
    value_at_margin: float = _DEFAULT_VALUE_AT_MARGIN,
) -> Quantity:
    """1 where `x` is within the bounds, decreasing with distance outside them.

    Args:
      x: a number or an array of any shape.
      bounds: inclusive `(lower, upper)`; either may be infinite. Each is a number, or an array that
        broadcasts with `x`, such as one bound per simulation, (N,).
      margin: distance from the bounds at which the value is `value_at_margin`; if 0, the value
        outside the bounds is 0. A number or an array, like the bounds.
      sigmoid: gaussian, hyperbolic, long_tail, reciprocal, cosine, linear, quadratic or
        tanh_squared.
      value_at_margin: between 0 and 1; 0 is allowed for cosine, linear and quadratic.

    Returns:
      A float for numbers, otherwise an array of the broadcast shape of `x`, bounds and margin.

    Raises:
      ValueError: a lower bound exceeds its upper bound, a margin is negative, the sigmoid is
        unknown or `value_at_margin` is out of range.
    """
    lower, upper = bounds
    # Comparing Python numbers gives the object False: then the order is valid and there are no
    # arrays.
    if (lower > upper) is not False or (margin < 0) is not False:
        _check_order(lower, upper, margin)
        if not _are_numbers(lower, upper, margin):
            found = _of_arrays(x, lower, upper, margin, *_sigmoid(sigmoid, value_at_margin))
            return float(found) if isinstance(x, _NUMBERS) and np.ndim(found) == 0 else found
        if margin != 0 and isinstance(x, _NUMBERS) and _are_short(lower, upper, margin):
            curve, scale = _sigmoid(sigmoid, value_at_margin)
            return float(_with_masks(x, lower, upper, margin, curve, scale))
    if margin == 0:
        return _indicator(x, lower, upper)
    curve, scale = _sigmoid(sigmoid, value_at_margin)
    if isinstance(x, float):  # fast path without arrays
        if lower <= x <= upper:
            return 1.0
        distance = lower - x if x < lower else x - upper
        # A NumPy scalar overflows to infinity where a Python float would raise.
        return float(curve(np.float64(distance / margin), scale))
    if isinstance(x, _NUMBERS):  # an integer, or a NumPy scalar that is not a float
        return float(_with_masks(x, lower, upper, margin, curve, scale))
    # Not with a list, which is refused, or a margin that is NaN.
    if margin > 0 and getattr(x, "ndim", 0) and _needs_no_masks(x, lower, upper):
        # Every sigmoid is exactly 1 at distance 0.
        distance = _distance(x, lower, upper)
        return curve(distance if margin == 1 else distance / margin, scale)
    return _with_masks(x, lower, upper, margin, curve, scale)


def _are_short(*numbers: object) -> bool:
    """Whether one of NumPy's numbers has less precision than Python's, in which NumPy computes."""
    return any(isinstance(n, np.floating) and not isinstance(n, np.float64) for n in numbers)


def mean_tolerance(
    x: np.ndarray,
    bounds: tuple[Quantity, Quantity] = (0.0, 0.0),
    margin: Quantity = 0.0,
    sigmoid: str = "gaussian",
    value_at_margin: float = _DEFAULT_VALUE_AT_MARGIN,
) -> np.ndarray:
    """Mean over the last axis of the elements' tolerances, (..., k) -> (...).

    The arguments are those of `tolerance`; bounds and margins per simulation have shape (N, 1).
    """
    values = tolerance(x, bounds, margin, sigmoid, value_at_margin)
    return arrays.mean(values)


def _check_order(lower: Quantity, upper: Quantity, margin: Quantity) -> None:
    """Raises ValueError if a lower bound exceeds its upper bound or a margin is negative.

    Only numbers and ndarrays are checked: reading an array on a GPU would wait for the device.
    """
    for is_wrong, message in (
        (lower > upper, "Lower bound must be <= upper bound."),
        (margin < 0, "`margin` must be non-negative."),
    ):
        if isinstance(is_wrong, np.ndarray):
            is_wrong = arrays.any_of(is_wrong)
        if isinstance(is_wrong, _BOOLEANS) and is_wrong:
            raise ValueError(message)


def _are_numbers(lower: Quantity, upper: Quantity, margin: Quantity) -> bool:
    """Whether bounds and margin are Python's or NumPy's numbers; faster than a loop."""
    numbers = isinstance(lower, _NUMBERS) and isinstance(upper, _NUMBERS)
    return numbers and isinstance(margin, _NUMBERS)


def _indicator(x: Quantity, lower: float, upper: float) -> Quantity:
    """1 where `x` is within the bounds, else 0."""
    if isinstance(x, float):
        return 1.0 if lower <= x <= upper else 0.0
    values = np.where(np.logical_and(lower <= x, x <= upper), 1.0, 0.0)
    return float(values) if isinstance(x, _NUMBERS) else values


def _with_masks(
    x: Quantity, lower: float, upper: float, margin: float, curve: _Curve, scale: float
) -> np.ndarray:
    """Values at `x` for bounds and a margin that are numbers."""
    in_bounds = np.logical_and(lower <= x, x <= upper)
    distance = np.where(x < lower, lower - x, x - upper)
    return np.where(in_bounds, 1.0, curve(distance / margin, scale))


def _of_arrays(
    x: Quantity, lower: Quantity, upper: Quantity, margin: Quantity, curve: _Curve, scale: float
) -> np.ndarray:
    """Values at `x` for array bounds or margins, bitwise equal to `_with_masks` per element."""
    in_bounds = np.logical_and(lower <= x, x <= upper)
    distance = np.where(x < lower, lower - x, x - upper)
    has_margin = margin != 0
    outside = curve(distance / np.where(has_margin, margin, 1.0), scale)
    return np.where(in_bounds, 1.0, np.where(has_margin, outside, 0.0))


def _needs_no_masks(x: np.ndarray, lower: float, upper: float) -> bool:
    """Whether `_distance` is valid for this dtype and these bounds."""
    return lower == upper or (lower > -np.inf and x.dtype == float)


def _distance(x: np.ndarray, lower: float, upper: float) -> np.ndarray:
    """Distance of each element from the interval; 0 inside."""
    if lower == upper:
        return abs(x - lower if lower else x)
    below = lower - x
    return np.maximum(below if upper == np.inf else np.maximum(below, x - upper), _ZERO)


def _square(x: Quantity) -> Quantity:
    # Squaring a number calls libm's `pow`, squaring an array computes `x * x`; the results differ
    # in the last bit for some values. A batch must round like a single simulation's number.
    if isinstance(x, float):
        return x**2
    return np.float_power(x, 2) if arrays.one_value_per_row(x) else x**2


def _at_least_zero(x: Quantity) -> Quantity:
    """`x` where it is positive, else 0; also 0 for NaN, as dm_control's comparisons give."""
    if isinstance(x, float):
        return x if x > 0 else 0.0
    return np.fmax(x, 0.0)


def _gaussian(x: Quantity, scale: float) -> Quantity:
    return np.exp(-0.5 * _square(x * scale))


def _hyperbolic(x: Quantity, scale: float) -> Quantity:
    return 1 / np.cosh(x * scale)


def _long_tail(x: Quantity, scale: float) -> Quantity:
    return 1 / (_square(x * scale) + 1)


def _reciprocal(x: Quantity, scale: float) -> Quantity:
    return 1 / (abs(x) * scale + 1)


def _cosine(x: Quantity, scale: float) -> Quantity:
    scaled = x * scale
    with np.errstate(invalid="ignore"):  # the cosine of an infinite distance
        raised = (1 + np.cos(np.pi * scaled)) / 2
    return np.where(abs(scaled) < 1, raised, 0.0)


def _linear(x: Quantity, scale: float) -> Quantity:
    return _at_least_zero(1.0 - x * scale)


def _quadratic(x: Quantity, scale: float) -> Quantity:
    if isinstance(x, _NUMBERS):
        return _at_least_zero(1.0 - _square(x * scale))
    # Scaling by a float64 gives a float64, so the constants do not change the dtype.
    scaled = x if scale == 1 and x.dtype == float else x * scale
    return np.fmax(_ONE - _square(scaled), _ZERO)


def _tanh_squared(x: Quantity, scale: float) -> Quantity:
    return 1 - _square(np.tanh(x * scale))


# Each sigmoid, and the scale at which its value at distance 1 is `v`.
_SIGMOIDS: dict[str, tuple[_Curve, Callable[[float], float]]] = {
    "gaussian": (_gaussian, lambda v: np.sqrt(-2 * np.log(v))),
    "hyperbolic": (_hyperbolic, lambda v: np.arccosh(1 / v)),
    "long_tail": (_long_tail, lambda v: np.sqrt(1 / v - 1)),
    "reciprocal": (_reciprocal, lambda v: 1 / v - 1),
    "cosine": (_cosine, lambda v: np.arccos(2 * v - 1) / np.pi),
    "linear": (_linear, lambda v: 1 - v),
    "quadratic": (_quadratic, lambda v: np.sqrt(1 - v)),
    "tanh_squared": (_tanh_squared, lambda v: np.arctanh(np.sqrt(1 - v))),
}
_REACH_ZERO = ("cosine", "linear", "quadratic")


@functools.lru_cache(maxsize=1024, typed=True)
def _sigmoid(sigmoid: str, value_at_1: float) -> tuple[_Curve, float]:
    """The curve named `sigmoid`, and the scale at which its value at distance 1 is `value_at_1`."""
    if sigmoid in _REACH_ZERO:
        if not 0 <= value_at_1 < 1:
            raise ValueError(
                f"`value_at_1` must be nonnegative and smaller than 1, got {value_at_1}."
            )
    elif not 0 < value_at_1 < 1:
        raise ValueError(f"`value_at_1` must be strictly between 0 and 1, got {value_at_1}.")
    if sigmoid not in _SIGMOIDS:
        # The text is dm_control's: its shipped tests compare it.
        raise ValueError(f"Unknown sigmoid type {sigmoid!r}.")
    curve, scale = _SIGMOIDS[sigmoid]
    return curve, scale(value_at_1)
