"""`utils.rewards.tolerance` gives the bits and types that dm_control's gives."""

import functools
import itertools
from typing import Any

import numpy as np
import pytest

from .oracle import BOTH, ours, theirs
from .same import assert_same, assert_same_outcome, assert_same_pair

pytestmark = pytest.mark.oracle

_INF = float("inf")
_SIGMOIDS = [
    "gaussian",
    "hyperbolic",
    "long_tail",
    "reciprocal",
    "cosine",
    "linear",
    "quadratic",
    "tanh_squared",
]
_ZERO_ALLOWED = {"cosine", "linear", "quadratic"}
_BOUNDS = [(0.0, 0.0), (-1, 1), (0.9, _INF), (-_INF, 0.3), (0, 0.01), (-_INF, _INF), (2.5, 2.5)]
_MARGINS = [0, 0.0, 1, 0.02, 0.35, 1.9, 1e6]
# Of each sigmoid, 100,000 in all. One value in 1,400 shows a square that is rounded another way.
_VALUES = 12_500

every_sigmoid = pytest.mark.parametrize("sigmoid", _SIGMOIDS)


def _values_at_margin(sigmoid: str) -> list[float]:
    return [0.1, 0.5, 0.999, 1e-8] + ([0, 0.0] if sigmoid in _ZERO_ALLOWED else [])


def _assert_same_tolerance(x: Any, **kwargs: Any) -> None:
    # dm_control computes both sides of each `where`, which overflow or are NaN for some `x`.
    with np.errstate(all="ignore"):
        values = [package("utils.rewards").tolerance(x, **kwargs) for package in BOTH]
    assert_same_pair(values, f"tolerance({x!r}, {kwargs})")


@every_sigmoid
@pytest.mark.parametrize("bounds", _BOUNDS)
@pytest.mark.parametrize("margin", _MARGINS)
def test_numbers_and_arrays_of_every_kind_give_the_same(
    sigmoid: str, bounds: tuple[float, float], margin: float
) -> None:
    random = np.random.RandomState(0)
    numbers = [*random.normal(0, 2, 5).tolist(), 0.0, -0.0, 1e-300, 1e200, -1e200, 2.5, 0.01]
    kinds: list[Any] = [0, 1, -3, 10**6, True, np.int64(4), np.int32(-2), np.float32(0.3), _INF]
    kinds += [-_INF, float("nan"), np.float64("nan"), np.bool_(False), np.float64(_INF)]
    for number in numbers:
        kinds += [number, np.float64(number), np.array(number), np.array([number])]
    for shape in [(0,), (1,), (2,), (21,), (4, 3), (1, 1), (2, 3, 4), (0, 3)]:
        array = random.normal(0, 2, shape)
        kinds += [array, array.astype(np.float32), np.rint(array).astype(int)]
    kinds += [random.normal(size=(3, 4)).T, random.normal(size=9)[::2]]
    for value_at_margin, x in itertools.product(_values_at_margin(sigmoid), kinds):
        _assert_same_tolerance(
            x, bounds=bounds, margin=margin, sigmoid=sigmoid, value_at_margin=value_at_margin
        )


@every_sigmoid
@pytest.mark.parametrize("kind", [float, np.float64])
def test_many_random_numbers_give_the_same(sigmoid: str, kind: type) -> None:
    numbers = np.random.RandomState(1).normal(0, 3, _VALUES)
    our_tolerance, their_tolerance = (package("utils.rewards").tolerance for package in BOTH)
    wrong = [
        number
        for number in map(kind, numbers)
        if our_tolerance(number, (-0.4, 0.7), 1.3, sigmoid)
        != their_tolerance(number, (-0.4, 0.7), 1.3, sigmoid)
    ]
    assert not wrong, f"{len(wrong)} of {_VALUES} differ, the first {wrong[0]!r}"


@every_sigmoid
def test_long_vectors_give_the_same(sigmoid: str) -> None:
    # Long enough for NumPy's SIMD loops and their remainders.
    numbers = np.random.RandomState(2).normal(0, 3, _VALUES)
    for length in (_VALUES, 1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 21, 63):
        x = numbers[:length]
        _assert_same_tolerance(x, bounds=(-0.4, 0.7), margin=1.3, sigmoid=sigmoid)


@every_sigmoid
def test_the_mean_of_a_vectors_tolerances_is_the_same(sigmoid: str) -> None:
    mean_tolerance = ours("utils.rewards").mean_tolerance
    for size in (1, 2, 5, 21, 56):
        for row in np.random.RandomState(size).normal(0, 1, (500, size)):
            expected = theirs("utils.rewards").tolerance(row, margin=1, sigmoid=sigmoid).mean()
            actual = mean_tolerance(row, margin=1, sigmoid=sigmoid)
            assert_same(actual, expected, f"{sigmoid}, {size} elements")


@pytest.mark.parametrize(
    "kwargs",
    [
        {"bounds": (1, 0)},
        {"margin": -0.05},
        {"margin": 1, "value_at_margin": 0},
        {"margin": 1, "value_at_margin": 1},
        {"margin": 1, "value_at_margin": -0.1},
        {"margin": 1, "value_at_margin": 1.5, "sigmoid": "linear"},
        {"margin": 1, "value_at_margin": -0.5, "sigmoid": "quadratic"},
        {"margin": 1, "sigmoid": "no such sigmoid"},
        # dm_control looks at neither where there is no margin.
        {"sigmoid": "no such sigmoid"},
        {"value_at_margin": 7},
    ],
)
@pytest.mark.parametrize("x", [0.5, 3, np.array([0.5, 3.0])])
def test_wrong_arguments_are_refused_alike(x: Any, kwargs: dict[str, Any]) -> None:
    calls = [functools.partial(package("utils.rewards").tolerance, x, **kwargs) for package in BOTH]
    assert_same_outcome(calls, f"tolerance({x!r}, {kwargs})")
