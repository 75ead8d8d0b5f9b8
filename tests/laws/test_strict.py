"""The strict array gives NumPy's bits for allowed operations and raises for others."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack.utils import arrays

from .strict import StrictArray, values_of

_X = np.random.RandomState(0).uniform(-1, 1, (4, 5, 3))
_M = np.random.RandomState(1).uniform(-1, 1, (4, 3, 3))
_WHICH = np.array([2, 0, 2])

_ALLOWED: list[Callable[[Any, Any], Any]] = [
    lambda x, m: x + 1.5 * x - x / (2 + x**2) // 0.3 % 0.7,
    lambda x, m: -abs(x) + (+x),
    lambda x, m: (x > 0) & ~(x < 0.5) | (x == x) ^ (x != 0.25),
    lambda x, m: 1.0 - x,
    lambda x, m: _X * x + x * _X,
    lambda x, m: x @ m,
    lambda x, m: np.float64(2.0) * x,
    lambda x, m: x[0],
    lambda x, m: x[..., 1:, 0],
    lambda x, m: x[..., None, -1],
    lambda x, m: x[:, _WHICH],
    lambda x, m: x[..., [0, 2]],
    lambda x, m: x[x > 0],
    lambda x, m: x[np.argmax(x[:, 0, 0])],
    lambda x, m: x.reshape(4, 15).T.copy().astype(np.float32).ravel(),
    lambda x, m: x.sum() + x.mean(axis=-1).max() - x.min(axis=(0, 1)).sum(),
    lambda x, m: x.any(axis=-1) & x.all(axis=-1),
    lambda x, m: x[0, 0].dot(x[0, 1]),
    lambda x, m: np.minimum(np.maximum(x, -0.5), np.float64(0.5)),
    lambda x, m: np.where(x > 0, x, 0.0),
    lambda x, m: np.concatenate([x, x[..., :1]], axis=-1),
    lambda x, m: np.stack((x, 2 * x)),
    lambda x, m: np.add.reduce(x, axis=-1),
    lambda x, m: np.broadcast_to(x[..., None], (4, 5, 3, 2)),
    lambda x, m: np.linalg.norm(x, axis=-1),
    lambda x, m: np.clip(x, -0.2, 0.3),
    lambda x, m: np.zeros_like(x),
    lambda x, m: np.einsum("ijk,ikl->ijl", x, m),
    lambda x, m: np.split(x, 2, axis=0)[1],
    lambda x, m: np.modf(x)[0],
    lambda x, m: arrays.norm(x),
    lambda x, m: arrays.norm(x[0, 0]),
    lambda x, m: arrays.to_frame(x, m.reshape(4, 9)),
    lambda x, m: arrays.concat([x, x]),
    lambda x, m: arrays.minimum_of([x, -x]),
]


@pytest.mark.parametrize("number", range(len(_ALLOWED)))
def test_allowed_operations_give_numpys_bits(number: int) -> None:
    compute = _ALLOWED[number]
    expected, found = compute(_X, _M), compute(StrictArray(_X), StrictArray(_M))
    assert isinstance(found, StrictArray)
    assert (found.shape, found.dtype) == (expected.shape, expected.dtype)
    assert values_of(found).tobytes() == np.asarray(expected).tobytes()


def test_it_has_the_attributes_of_an_array() -> None:
    array = StrictArray(_X)
    assert (array.shape, array.ndim, array.size, len(array)) == (_X.shape, 3, _X.size, 4)
    assert array.dtype == float
    assert not hasattr(array, "data")
    assert repr(array) == "StrictArray(shape=(4, 5, 3), dtype=float64)"


def test_elements_are_written_and_views_see_it() -> None:
    array = StrictArray(np.zeros((2, 3)))
    row = array[1]
    array[..., StrictArray(np.array(2))] = StrictArray(np.ones(2))
    array[0, :2] = 5.0
    array += 1
    np.testing.assert_array_equal(values_of(array), [[6, 6, 2], [1, 1, 2]])
    np.testing.assert_array_equal(values_of(row), [1, 1, 2])


def test_results_are_written_into_strict_arrays() -> None:
    array: Any = StrictArray(_X)
    out: Any = StrictArray(np.empty_like(_X))
    assert values_of(np.multiply(array, 2.0, out=out)).tobytes() == (2 * _X).tobytes()
    assert values_of(out).tobytes() == (2 * _X).tobytes()


@pytest.mark.parametrize(
    ("refused", "message"),
    [
        (np.asarray, "np.asarray()"),
        (np.array, "np.asarray()"),
        (lambda x: np.ones(3) @ np.array([x[0, 0, 0], 1.0, 2.0]), " of a strict array"),
        (lambda x: float(x[0, 0, 0]), "float()"),
        (lambda x: int(x[0, 0, 0]), "int()"),
        (lambda x: [1, 2][x[0, 0, 0]], "use as an index"),
        (lambda x: 1 if x[0, 0, 0] > 0 else 2, "bool()"),
        (lambda x: max(x[0, 0, 0], 0.5), "bool()"),
        (lambda x: x[0, 0, 0] > 0 and x, "bool()"),
        (lambda x: list(x), "iteration"),
        (lambda x: [*x[0, 0]], "iteration"),
        (lambda x: 0.0 in x, "`in`"),
        (lambda x: x.item(), "item()"),
        (lambda x: x.tolist(), "tolist()"),
        (lambda x: np.multiply(x, 2.0, out=np.empty_like(_X)), "np.multiply"),
        (lambda x: np.clip(x, 0, 1, out=np.empty_like(_X)), "np.clip"),
        (lambda x: x.sum(out=np.empty(())), "sum"),
        (lambda x: np.copyto(np.empty_like(_X), x), "np.copyto"),
        (lambda x: np.empty_like(_X).__setitem__(..., x), "np.asarray()"),
        (lambda x: np.putmask(np.empty_like(_X), x > 0, x), "np.putmask"),
    ],
)
def test_refused_operations_raise_and_are_named(
    refused: Callable[[StrictArray], Any], message: str
) -> None:
    with pytest.raises(TypeError) as raised:
        refused(StrictArray(_X.copy()))
    assert message in str(raised.value)


def test_an_ndarray_is_never_changed_in_place_by_a_strict_one() -> None:
    array = _X.copy()
    with pytest.raises(TypeError, match=r"np.add of a strict array cannot write into out="):
        array += StrictArray(_X)
    np.testing.assert_array_equal(array, _X)
