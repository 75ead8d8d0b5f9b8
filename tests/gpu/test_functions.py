"""NumPy's functions have counterparts on a device with the same arguments and results."""

from typing import Any

import numpy as np
import pytest

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
functions: Any = pytest.importorskip("limberjack.gpu.functions")
tensors: Any = pytest.importorskip("limberjack.gpu.tensors")

_X = np.random.RandomState(0).uniform(0.1, 0.9, (4, 3)).astype(np.float32)
_Y = np.random.RandomState(1).uniform(0.1, 0.9, (4, 3)).astype(np.float32)
_CALLS = {
    "all": lambda x, y: np.all(x > 0.5, axis=-1),
    "any": lambda x, y: np.any(x > 0.5, axis=-1, keepdims=True),
    "amax": lambda x, y: np.amax(x, axis=0),
    "amin": lambda x, y: np.amin(x),
    "argmax": lambda x, y: np.argmax(x, axis=-1),
    "argmin": lambda x, y: np.argmin(x),
    "atleast_1d": lambda x, y: np.atleast_1d(x[0, 0]),
    "broadcast_to": lambda x, y: np.broadcast_to(x[0], (2, 3)),
    "clip": lambda x, y: np.clip(x, 0.2, None) + np.clip(x, y, 0.9),
    "concatenate": lambda x, y: np.concatenate((x, y), axis=-1) + np.concatenate((x, y), None)[0],
    "copy": lambda x, y: np.copy(x),
    "cross": lambda x, y: np.cross(x, y) + np.cross(x[0], y),
    "cumsum": lambda x, y: np.cumsum(x, axis=1)[1, 2] + np.cumsum(y),
    "diff": lambda x, y: np.diff(x),
    "dot": lambda x, y: np.dot(x, y.T) + np.dot(x[0], y[0]) * np.dot(2.0, x[0, 0]),
    "einsum": lambda x, y: np.einsum("ij,kj->ik", x, y),
    "expand_dims": lambda x, y: np.expand_dims(x, 1) + np.expand_dims(y, (0, -1))[0, 0, 0],
    "flip": lambda x, y: np.flip(x, axis=0) + np.flip(y) + np.flip(x, (-1, 0)),
    "full_like": lambda x, y: np.full_like(x, 0.5),
    "hstack": lambda x, y: np.hstack((x, y)),
    "linalg.norm": lambda x, y: (
        np.linalg.norm(x, axis=-1) * np.linalg.norm(y, None, None, True)
        + np.linalg.norm(x > y, axis=1)
    ),
    "max": lambda x, y: np.max(x, axis=(0, 1)),
    "mean": lambda x, y: np.mean(x, axis=-1) + np.mean(y) + np.mean(x > y),
    "min": lambda x, y: np.min(x, axis=1),
    "moveaxis": lambda x, y: np.moveaxis(x, 0, 1),
    "nan_to_num": lambda x, y: (
        np.nan_to_num(np.where(x > y, np.nan, x))
        + np.nan_to_num(np.where(x > y, np.inf, -np.inf), posinf=2.0, neginf=3.0)
    ),
    "ones_like": lambda x, y: np.ones_like(x),
    "prod": lambda x, y: np.prod(x, axis=-1) * np.prod(y) + np.prod(x, axis=(-2, 1)),
    "ravel": lambda x, y: np.ravel(x),
    "repeat": lambda x, y: np.repeat(x, 2, axis=0),
    "reshape": lambda x, y: np.reshape(x, (3, 4)) + np.reshape(y, -1)[0],
    "roll": lambda x, y: np.roll(x, 1, axis=0),
    "sort": lambda x, y: np.sort(x),
    "split": lambda x, y: np.split(x, 2)[1] + np.split(y, [2])[0],
    "squeeze": lambda x, y: np.squeeze(x[:1]) + np.squeeze(y[:1], axis=0),
    "stack": lambda x, y: np.stack((x, y), axis=1),
    "std": lambda x, y: np.std(x, axis=-1) + np.std(y, ddof=1) + np.std(x > y),
    "sum": lambda x, y: np.sum(x, axis=-1) + np.sum(y),
    "swapaxes": lambda x, y: np.swapaxes(x, 0, 1),
    "take": lambda x, y: np.take(x, [0, 2], axis=-1) + np.take(y, np.array([1, 5])),
    "take_along_axis": lambda x, y: np.take_along_axis(x, np.argmax(y, -1, keepdims=True), -1),
    "tile": lambda x, y: np.tile(x, (2, 1)) * np.tile(y[0], 1),
    "transpose": lambda x, y: np.transpose(x) @ np.transpose(y, (0, 1)) + x.transpose() @ y,
    "var": lambda x, y: np.var(x, axis=-1),
    "vstack": lambda x, y: np.vstack((x, y)),
    "where": lambda x, y: (
        np.where(x > y, x, 0.0) + np.where(True, y, 0.0) + np.where(np.floor(2 * x), 1.0, y)
    ),
    "zeros_like": lambda x, y: np.zeros_like(x, dtype=float),
    "ufuncs": lambda x, y: (
        np.arctan2(x, y)
        + np.float_power(x, 2)
        + np.cbrt(x)
        + np.degrees(x)
        + np.hypot(x, y)
        + np.fabs(x - y)
    ),
    "reductions": lambda x, y: (
        np.add.reduce(x) + np.maximum.reduce(y, axis=0) + np.multiply.reduce(x, axis=0)
    ),
    "comparisons": lambda x, y: np.equal(x, y) | np.not_equal(x, 0.5) & np.invert(x < y),
}


@pytest.mark.parametrize("name", _CALLS)
def test_a_function_gives_numpys_result(name: str) -> None:
    compute = _CALLS[name]
    expected = compute(_X, _Y)
    found = compute(*(tensors.device_array(torch.from_numpy(each)) for each in (_X, _Y)))
    assert tuple(found.shape) == np.shape(expected)
    np.testing.assert_allclose(as_numpy(found), expected, rtol=1e-5, atol=1e-6)


def test_every_function_is_tested_above() -> None:
    written = {functions.name_of(each).removeprefix("np.") for each in functions._FUNCTIONS}
    # These return no array, or fill one with what was in the memory.
    assert written - {"copyto", "empty_like", "ndim", "shape"} <= set(_CALLS)


def test_shapes_are_known_and_arrays_are_copied_into() -> None:
    x = tensors.device_array(torch.from_numpy(_X.copy()))
    assert (np.shape(x), np.ndim(x), np.empty_like(x).shape) == ((4, 3), 2, (4, 3))
    np.copyto(x, _Y)
    np.testing.assert_array_equal(as_numpy(x), _Y)
    np.copyto(x, 0.0, where=x > 0.5)
    np.testing.assert_array_equal(as_numpy(x), np.where(_Y > 0.5, np.float32(0), _Y))
    x[0] = np.nan
    np.nan_to_num(x, copy=False)
    assert not as_numpy(x)[0].any()


def test_a_function_without_a_counterpart_is_refused_with_the_nearest_one() -> None:
    with pytest.raises(TypeError, match=r"np\.nansum is not available .* 'np\.sum'"):
        np.nansum(tensors.device_array(torch.from_numpy(_X)))
