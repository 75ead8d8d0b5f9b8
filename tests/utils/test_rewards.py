"""`tolerance`: its shape, its bits for numbers, vectors and batches, and dm_control's beside it."""

import functools
import itertools
import math
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from limberjack.utils import arrays, rewards
from tests.oracle.same import assert_same, assert_same_outcome, assert_same_pair

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
_REACH_ZERO = ("cosine", "linear", "quadratic")
_every_sigmoid = pytest.mark.parametrize("sigmoid", _SIGMOIDS)


@_every_sigmoid
@pytest.mark.parametrize("bounds", [(0.0, 0.0), (-1.5, 0.5), (1.4, np.inf), (-np.inf, -0.1)])
@pytest.mark.parametrize("margin", [0.0, 0.3, 1.0, 5.0])
def test_it_is_1_inside_and_falls_outside_alike_on_both_sides(
    sigmoid: str, bounds: tuple[float, float], margin: float
) -> None:
    lower, upper = bounds
    inside = np.clip(np.linspace(-3, 3, 61), lower, upper)
    values = rewards.tolerance(inside, bounds, margin, sigmoid)
    np.testing.assert_array_equal(values, np.ones_like(inside))
    numbers = [rewards.tolerance(float(x), bounds, margin, sigmoid) for x in inside]
    assert numbers == [1.0] * len(inside)
    distance = np.linspace(1e-3, 10, 400)
    sides = []
    for edge, sign in ((lower, -1), (upper, 1)):
        if np.isfinite(edge):
            sides.append(rewards.tolerance(edge + sign * distance, bounds, margin, sigmoid))
    for values in sides:
        assert np.all((values >= 0) & (values < 1))
        # Beyond where it is flat in floating point, never growing.
        assert np.all(np.diff(values) <= 0)
        # The distance is rounded differently on either side of its bound.
        np.testing.assert_allclose(values, sides[0], rtol=0, atol=1e-12)
    if margin == 0:
        assert not np.any(sides)


@_every_sigmoid
@pytest.mark.parametrize("margin", [0.0, 0.5, 1.0])
def test_around_a_single_point_the_distance_is_measured_from_there(
    sigmoid: str, margin: float
) -> None:
    x = np.array([2.0, 1.9, 2.25, 0.0])
    at_2 = rewards.tolerance(x, (2.0, 2.0), margin, sigmoid)
    assert at_2[0] == 1.0
    assert (at_2[1:] < 1.0).all()
    shifted = rewards.tolerance(x - 2.0, (0.0, 0.0), margin, sigmoid)
    np.testing.assert_array_equal(at_2, shifted)
    numbers = [rewards.tolerance(float(one), (2.0, 2.0), margin, sigmoid) for one in x]
    # A number squared rounds otherwise than an array squared.
    np.testing.assert_allclose(at_2, numbers, rtol=1e-14)


def test_the_mean_is_over_the_last_axis_for_any_number_of_rows() -> None:
    x = np.array([[0.0, 0.0, 9.0, 9.0], [0.0, 9.0, 9.0, 9.0]])
    assert rewards.mean_tolerance(x).tolist() == [0.5, 0.25]
    assert rewards.mean_tolerance(x[0]) == 0.5


@_every_sigmoid
@pytest.mark.parametrize("value", [0.0, 1e-5, 0.1, 0.5, 0.99])
@pytest.mark.parametrize("margin", [0.2, 1.0, 7.0])
def test_at_the_margin_it_has_the_value_asked_for(
    sigmoid: str, value: float, margin: float
) -> None:
    if value == 0 and sigmoid not in _REACH_ZERO:
        with pytest.raises(ValueError, match="strictly between 0 and 1"):
            rewards.tolerance(0.0, (0, 0), margin, sigmoid, value)
        return
    for x in (-1.0 - margin, 2.0 + margin):
        got = rewards.tolerance(x, (-1.0, 2.0), margin, sigmoid, value)
        # The scale that makes it so is itself rounded.
        assert got == pytest.approx(value, abs=1e-9)


@_every_sigmoid
def test_the_default_at_the_margin_is_a_tenth(sigmoid: str) -> None:
    assert rewards.tolerance(1.0, margin=1.0, sigmoid=sigmoid) == pytest.approx(0.1)


def test_the_gaussian_is_the_default_and_one_by_its_formula() -> None:
    x = np.linspace(-2, 2, 41)
    # exp(-x**2 / 2 s**2) through 0.1 at the margin.
    np.testing.assert_allclose(
        rewards.tolerance(x, margin=0.5), 0.1 ** ((x / 0.5) ** 2), rtol=1e-12
    )


@_every_sigmoid
@pytest.mark.parametrize("bounds", [(0.0, 0.0), (0.25, 0.25), (-0.5, 0.5), (1.4, np.inf)])
@pytest.mark.parametrize("margin", [0.0, 0.35, 1.0])
def test_a_batch_has_the_bits_of_its_numbers(
    sigmoid: str, bounds: tuple[float, float], margin: float
) -> None:
    stream = np.random.RandomState(1)
    x = stream.randn(2_000) * 10.0 ** stream.uniform(-3, 1, 2_000)
    one_by_one = [rewards.tolerance(float(value), bounds, margin, sigmoid) for value in x]
    with arrays.rows_of_a_batch(len(x)):
        together = rewards.tolerance(x, bounds, margin, sigmoid)
    np.testing.assert_array_equal(together, one_by_one)


@_every_sigmoid
@pytest.mark.parametrize("length", [2, 5, 21])
def test_a_batch_of_vectors_has_the_bits_of_its_vectors(sigmoid: str, length: int) -> None:
    x = np.random.RandomState(2).randn(1_000, length) * 3
    one_by_one = [rewards.mean_tolerance(row, margin=1, sigmoid=sigmoid) for row in x]
    with arrays.rows_of_a_batch(len(x)):
        together = rewards.mean_tolerance(x, margin=1, sigmoid=sigmoid)
    np.testing.assert_array_equal(together, one_by_one)
    # Even where there are as many rows as numbers in a vector.
    with arrays.rows_of_a_batch(length):
        square = rewards.mean_tolerance(x[:length], margin=1, sigmoid=sigmoid)
    np.testing.assert_array_equal(square, one_by_one[:length])


def test_the_power_of_a_batch_of_numbers_is_not_that_of_a_vector() -> None:
    # The reason for `rows_of_a_batch`: libm's pow and x * x differ in the last bit.
    x = np.random.RandomState(0).randn(100_000)
    vector = rewards.tolerance(x, margin=1.3, sigmoid="quadratic", value_at_margin=0.2)
    with arrays.rows_of_a_batch(len(x)):
        batch = rewards.tolerance(x, margin=1.3, sigmoid="quadratic", value_at_margin=0.2)
    different = np.count_nonzero(vector != batch)
    assert different < 0.01 * len(x)
    np.testing.assert_allclose(vector, batch, rtol=1e-12, atol=1e-15)


def test_a_number_is_squared_by_pow_as_in_dm_control() -> None:
    numbers = np.random.RandomState(0).uniform(1e-3, 4, 50_000).tolist()
    got = [rewards.tolerance(x, (0, 0), 1.0, "long_tail", 0.5) for x in numbers]
    # About one number in a thousand differs from the product in the last bit.
    assert got == [1 / (math.pow(x, 2) + 1) for x in numbers]


def test_mean_tolerance_is_the_mean_of_each_elements_tolerance() -> None:
    x = np.random.RandomState(3).randn(7, 4)
    expected = rewards.tolerance(x, (-0.1, 0.1), 1.0, "linear").mean(axis=-1)
    got = rewards.mean_tolerance(x, bounds=(-0.1, 0.1), margin=1.0, sigmoid="linear")
    np.testing.assert_array_equal(got, expected)
    assert rewards.mean_tolerance(np.zeros((2, 3, 4)), margin=1).shape == (2, 3)


@pytest.mark.parametrize("margin", [0.0, 1.0])
@pytest.mark.parametrize("x", [0.3, 1, np.float64(2.0), np.float32(-2.0), True])
def test_a_number_gives_a_float(x: Any, margin: float) -> None:
    value = rewards.tolerance(x, (0.0, 1.0), margin)
    assert type(value) is float
    assert value == rewards.tolerance(np.array([x], float), (0.0, 1.0), margin)[0]


@pytest.mark.parametrize("margin", [0.0, 0.5])
@pytest.mark.parametrize("x", [-0.2, 0.7, 1.2, np.inf, np.nan])
def test_bounds_from_a_model_are_as_good_as_python_numbers(x: float, margin: float) -> None:
    expected = rewards.tolerance(x, (0.0, 1.0), margin)
    for bounds in ((0, np.float64(1)), (np.float64(0), 1.0)):
        for given in (x, np.float64(x)):
            value = rewards.tolerance(given, bounds, np.float64(margin))
            assert type(value) is float
            np.testing.assert_equal(value, expected)  # NaN equals NaN
    value = rewards.tolerance(x, (0.0, np.array(1.0)), margin)
    assert type(value) is float
    np.testing.assert_equal(value, expected)


@pytest.mark.parametrize("margin", [0.0, 1.0])
@pytest.mark.parametrize("bounds", [(0.0, 0.0), (0.0, 1.0)])
def test_an_array_keeps_its_shape_and_is_not_written_to(bounds: Any, margin: float) -> None:
    for shape in ((), (1,), (3,), (2, 3), (0,)):
        x = np.full(shape, 0.7)
        value = rewards.tolerance(x, bounds, margin)
        assert np.shape(value) == shape
        assert np.all(x == 0.7)
        assert not np.shares_memory(value, x)


@_every_sigmoid
@pytest.mark.parametrize("which", ["bounds", "margin", "all"])
def test_bounds_and_margins_of_rows_have_the_bits_of_each_rows_numbers(
    sigmoid: str, which: str
) -> None:
    stream = np.random.RandomState(4)
    x = stream.randn(5_000) * 10.0 ** stream.uniform(-3, 0.5, 5_000)
    lower = stream.uniform(-1, 0, 5_000) if which != "margin" else -0.5
    upper = stream.uniform(0, 1, 5_000) if which != "margin" else 0.25
    margin = (
        stream.uniform(0.1, 2, 5_000) * (stream.rand(5_000) < 0.8) if which != "bounds" else 0.3
    )
    rows = np.broadcast_arrays(x, lower, upper, margin)
    # As a task reads them in one simulation: NumPy's floats.
    one_by_one = [
        rewards.tolerance(a, (b, c), d, sigmoid) for a, b, c, d in zip(*rows, strict=True)
    ]
    with arrays.rows_of_a_batch(len(x)):
        together = rewards.tolerance(x, (lower, upper), margin, sigmoid)
    np.testing.assert_array_equal(together, one_by_one)


def test_a_radius_of_each_row_is_the_bound_of_its_vector() -> None:
    # As in a task whose target has another size in each row.
    stream = np.random.RandomState(5)
    x, radius = stream.randn(100, 3), stream.uniform(0.1, 1, 100)
    one_by_one = [
        rewards.mean_tolerance(row, bounds=(0, size), margin=0.5)
        for row, size in zip(x, radius, strict=True)
    ]
    with arrays.rows_of_a_batch(len(x)):
        together = rewards.mean_tolerance(x, bounds=(0, radius[:, None]), margin=0.5)
    np.testing.assert_array_equal(together, one_by_one)


@pytest.mark.parametrize(
    ("bounds", "margin", "match"),
    [
        ((np.zeros(3), np.array([1.0, -1.0, 1.0])), 1.0, "Lower bound must be <= upper bound"),
        ((np.float64(1), np.float64(0)), 1.0, "Lower bound must be <= upper bound"),
        ((0.0, 1.0), np.array([1.0, 0.0, -1.0]), "`margin` must be non-negative"),
    ],
)
def test_bad_arguments_of_one_row_are_refused(bounds: Any, margin: Any, match: str) -> None:
    with pytest.raises(ValueError, match=match):
        rewards.tolerance(np.zeros(3), bounds, margin)


class _Foreign:
    """An array other than an ndarray, supported by NumPy's functions through its protocols."""

    def __init__(self, values: np.ndarray) -> None:
        self.values, self.shape = values, values.shape
        self.ndim, self.dtype = values.ndim, values.dtype

    def __array__(self, *args: Any, **kwargs: Any) -> np.ndarray:
        raise TypeError("this array is not to be converted")

    def __bool__(self) -> bool:
        raise TypeError("this array is not to be waited for")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **kwargs: Any) -> Any:
        return _Foreign(getattr(ufunc, method)(*map(_plain, inputs), **kwargs))

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        return _Foreign(func(*map(_plain, args), **kwargs))


def _operator(ufunc: np.ufunc, is_swapped: bool = False) -> Any:
    return lambda a, b: ufunc(b, a) if is_swapped else ufunc(a, b)


for _name in ("add", "sub", "mul", "truediv", "pow"):
    _ufunc = {"sub": np.subtract, "mul": np.multiply, "truediv": np.divide, "pow": np.power}.get(
        _name, np.add
    )
    setattr(_Foreign, f"__{_name}__", _operator(_ufunc))
    setattr(_Foreign, f"__r{_name}__", _operator(_ufunc, is_swapped=True))
for _name, _ufunc in (
    ("lt", np.less),
    ("le", np.less_equal),
    ("gt", np.greater),
    ("ge", np.greater_equal),
    ("ne", np.not_equal),
):
    setattr(_Foreign, f"__{_name}__", _operator(_ufunc))
_Foreign.__abs__ = lambda self: np.abs(self)  # pyright: ignore[reportAttributeAccessIssue]


def _plain(value: Any) -> Any:
    return value.values if isinstance(value, _Foreign) else value


@_every_sigmoid
@pytest.mark.parametrize("bounds", [(0.0, 0.0), (-0.5, 0.5), (1.4, np.inf)])
@pytest.mark.parametrize("margin", [0.0, 0.35, 1.0])
def test_arrays_that_are_not_ndarrays_have_the_same_bits(
    sigmoid: str, bounds: tuple[float, float], margin: float
) -> None:
    x = np.random.RandomState(6).randn(1_000)
    with arrays.rows_of_a_batch(len(x)):
        expected = rewards.tolerance(x, bounds, margin, sigmoid)
        foreign: Any = rewards.tolerance(_Foreign(x), bounds, margin, sigmoid)  # pyright: ignore[reportArgumentType, reportCallIssue]
        rows = tuple(_Foreign(np.full(1_000, bound)) for bound in bounds)
        of_rows: Any = rewards.tolerance(x, rows, margin, sigmoid)  # pyright: ignore[reportArgumentType, reportCallIssue]
    assert type(foreign) is type(of_rows) is _Foreign
    np.testing.assert_array_equal(foreign.values, expected)
    np.testing.assert_array_equal(of_rows.values, expected)


@_every_sigmoid
def test_infinitely_far_away_it_is_0_and_nan_is_not_1(sigmoid: str) -> None:
    for x in (np.inf, -np.inf):
        for value in (x, np.array([x])):
            assert rewards.tolerance(value, (-1, 1), 1.0, sigmoid) == 0.0
    assert rewards.tolerance(float("nan"), (-1, 1), 1.0, sigmoid) != 1.0


@_every_sigmoid
def test_a_margin_that_is_nan_leaves_1_within_the_bounds_as_in_dm_control(sigmoid: str) -> None:
    x = np.array([0.0, 0.5])
    near, far = rewards.tolerance(x, margin=np.nan, sigmoid=sigmoid)
    assert near == 1.0
    assert np.isnan(far) or sigmoid in _REACH_ZERO


def test_a_list_is_refused_as_by_dm_control() -> None:
    for margin in (0.0, 0.5):
        with pytest.raises(TypeError):
            rewards.tolerance([1, 2], (0.0, 1.0), margin)  # pyright: ignore


@pytest.mark.parametrize("sigmoid", _REACH_ZERO)
def test_sigmoids_that_reach_0_are_0_for_nan(sigmoid: str) -> None:
    for value in (float("nan"), np.array([np.nan, 0.0])):
        assert np.ravel(rewards.tolerance(value, (-1, 1), 1.0, sigmoid))[0] == 0.0


@pytest.mark.parametrize(
    ("kwargs", "match"),
    [
        ({"bounds": (1, 0)}, "Lower bound must be <= upper bound"),
        ({"margin": -0.1}, "`margin` must be non-negative"),
        ({"margin": 1, "sigmoid": "cubic"}, "Unknown sigmoid type 'cubic'"),
        ({"margin": 1, "value_at_margin": 1}, "strictly between 0 and 1, got 1"),
        ({"margin": 1, "value_at_margin": -0.5}, "strictly between 0 and 1, got -0.5"),
        ({"margin": 1, "sigmoid": "linear", "value_at_margin": 1}, "smaller than 1, got 1"),
        ({"margin": 1, "sigmoid": "linear", "value_at_margin": -1}, "nonnegative"),
    ],
)
def test_bad_arguments_are_refused(kwargs: Any, match: str) -> None:
    for x in (0.5, np.zeros(3)):
        with pytest.raises(ValueError, match=match):
            rewards.tolerance(x, **kwargs)


# dm_control's, bit for bit.

_BOUNDS = [
    *[(0.0, 0.0), (-1, 1), (0.9, np.inf), (-np.inf, 0.3)],
    *[(0, 0.01), (-np.inf, np.inf), (2.5, 2.5)],
]
_MARGINS = [0, 0.0, 1, 0.02, 0.35, 1.9, 1e6]
# Of each sigmoid, 100,000 in all. One value in 1,400 shows a square that is rounded another way.
_VALUES = 12_500


@pytest.fixture(scope="module")
def dm_controls(theirs: Callable[[str], ModuleType]) -> Any:
    """dm_control's module of rewards."""
    return theirs("utils.rewards")


def _values_at_margin(sigmoid: str) -> list[float]:
    return [0.1, 0.5, 0.999, 1e-8] + ([0, 0.0] if sigmoid in _REACH_ZERO else [])


def _assert_same_tolerance(dm_controls: Any, x: Any, **kwargs: Any) -> None:
    # dm_control computes both sides of each `where`, which overflow or are NaN for some `x`.
    with np.errstate(all="ignore"):
        values = [module.tolerance(x, **kwargs) for module in (rewards, dm_controls)]
    try:
        assert_same_pair(values, "tolerance")
    except AssertionError as error:
        error.add_note(f"tolerance({x!r}, {kwargs})")  # its text takes longer than the comparison
        raise


@pytest.mark.oracle
@_every_sigmoid
@pytest.mark.parametrize("bounds", _BOUNDS)
@pytest.mark.parametrize("margin", _MARGINS)
def test_numbers_and_arrays_of_every_kind_give_dm_controls(
    dm_controls: Any, sigmoid: str, bounds: tuple[float, float], margin: float
) -> None:
    random = np.random.RandomState(0)
    numbers = [*random.normal(0, 2, 5).tolist(), 0.0, -0.0, 1e-300, 1e200, -1e200, 2.5, 0.01]
    kinds: list[Any] = [0, 1, -3, 10**6, True, np.int64(4), np.int32(-2), np.float32(0.3), np.inf]
    kinds += [-np.inf, float("nan"), np.float64("nan"), np.bool_(False), np.float64(np.inf)]
    for number in numbers:
        kinds += [number, np.float64(number), np.array(number), np.array([number])]
    for shape in [(0,), (1,), (2,), (21,), (4, 3), (1, 1), (2, 3, 4), (0, 3)]:
        array = random.normal(0, 2, shape)
        kinds += [array, array.astype(np.float32), np.rint(array).astype(int)]
    kinds += [random.normal(size=(3, 4)).T, random.normal(size=9)[::2]]
    for value, x in itertools.product(_values_at_margin(sigmoid), kinds):
        kwargs = {"bounds": bounds, "margin": margin, "sigmoid": sigmoid, "value_at_margin": value}
        _assert_same_tolerance(dm_controls, x, **kwargs)


@pytest.mark.oracle
@_every_sigmoid
@pytest.mark.parametrize("kind", [float, np.float64])
def test_many_random_numbers_give_dm_controls(dm_controls: Any, sigmoid: str, kind: type) -> None:
    numbers = map(kind, np.random.RandomState(1).normal(0, 3, _VALUES))
    wrong = [
        number
        for number in numbers
        if rewards.tolerance(number, (-0.4, 0.7), 1.3, sigmoid)
        != dm_controls.tolerance(number, (-0.4, 0.7), 1.3, sigmoid)
    ]
    assert not wrong, f"{len(wrong)} of {_VALUES} differ, the first {wrong[0]!r}"


@pytest.mark.oracle
@_every_sigmoid
def test_long_vectors_give_dm_controls(dm_controls: Any, sigmoid: str) -> None:
    # Long enough for NumPy's SIMD loops and their remainders.
    numbers = np.random.RandomState(2).normal(0, 3, _VALUES)
    kwargs = {"bounds": (-0.4, 0.7), "margin": 1.3, "sigmoid": sigmoid}
    for length in (_VALUES, 1, 2, 3, 5, 7, 8, 9, 15, 16, 17, 21, 63):
        _assert_same_tolerance(dm_controls, numbers[:length], **kwargs)


@pytest.mark.oracle
@_every_sigmoid
def test_the_mean_of_a_vectors_tolerances_is_dm_controls(dm_controls: Any, sigmoid: str) -> None:
    for size in (1, 2, 5, 21, 56):
        for row in np.random.RandomState(size).normal(0, 1, (500, size)):
            expected = dm_controls.tolerance(row, margin=1, sigmoid=sigmoid).mean()
            actual = rewards.mean_tolerance(row, margin=1, sigmoid=sigmoid)
            assert_same(actual, expected, f"{sigmoid}, {size} elements")


@pytest.mark.oracle
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
def test_bad_arguments_are_refused_as_by_dm_control(
    dm_controls: Any, x: Any, kwargs: dict[str, Any]
) -> None:
    modules = (rewards, dm_controls)
    calls = [functools.partial(module.tolerance, x, **kwargs) for module in modules]
    assert_same_outcome(calls, f"tolerance({x!r}, {kwargs})")


@pytest.mark.oracle
@_every_sigmoid
def test_bounds_and_margins_of_less_precision_give_dm_controls(
    dm_controls: Any, sigmoid: str
) -> None:
    kinds = [float, np.float16, np.float32, np.float64, np.array]
    numbers = [0.5, -0.3, 0.1, 2, np.float64(0.7), np.float32(0.7), np.array([0.1, 0.9])]
    for x, lower, upper, margin in itertools.product(numbers, kinds, kinds, kinds):
        how = {"bounds": (lower(0.0), upper(0.2)), "margin": margin(0.3), "sigmoid": sigmoid}
        _assert_same_tolerance(dm_controls, x, **how)
