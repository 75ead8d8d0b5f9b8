"""An array on a device computes what NumPy does, and refuses what would wait for the device."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from limberjack.utils import arrays, rewards
from tests.laws.test_strict import _ALLOWED, _M, _WHICH, _X

from .on_device import as_numpy, torch

pytestmark = pytest.mark.gpu
tensors: Any = pytest.importorskip("limberjack.gpu.tensors")


def _on_device(values: np.ndarray) -> Any:
    kind = np.float32 if values.dtype.kind == "f" else values.dtype
    return tensors.device_array(torch.from_numpy(values.astype(kind)))


@pytest.mark.parametrize("number", range(len(_ALLOWED)))
def test_what_a_strict_array_allows_gives_numpys_values(number: int) -> None:
    compute = _ALLOWED[number]
    expected, found = compute(_X, _M), compute(_on_device(_X), _on_device(_M))
    assert isinstance(found, tensors.DeviceArray)
    assert found.dtype in (torch.float32, torch.bool)
    assert tuple(found.shape) == np.shape(expected)
    # float32 beside float64; the values are of the order of one.
    np.testing.assert_allclose(as_numpy(found), expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    ("refused", "message"),
    [
        (np.asarray, "np.asarray() would take an array out of the device's memory: use the array"),
        (np.array, "np.asarray()"),
        (lambda x: float(x[0, 0, 0]), "float() would take"),
        (lambda x: int(x[0, 0, 0]), "int() would take"),
        (lambda x: [1, 2][x[0, 0, 0]], "use as an index of a list would take"),
        (lambda x: 1 if x[0, 0, 0] > 0 else 2, "write np.where for if"),
        (lambda x: max(x[0, 0, 0], 0.5), "np.minimum and np.maximum for min and max"),
        (lambda x: list(x), "iteration, as by `for` and unpacking, would take"),
        (lambda x: 0.0 in x, "`in` would take"),
        (lambda x: x.item(), "item() would take"),
        (lambda x: x.tolist(), "tolist() would take"),
        (lambda x: np.multiply(x, 2.0, out=np.empty_like(_X)), "np.multiply of an array on a"),
        (lambda x: np.clip(x, 0, 1, out=np.empty_like(_X)), "np.clip of an array on a device"),
        (
            lambda x: np.copyto(np.empty_like(_X), x),
            "np.copyto of an array on a device cannot write",
        ),
        (lambda x: np.empty_like(_X).__setitem__(..., x), "np.asarray()"),
        (lambda x: np.percentile(x, 5), "np.percentile is not available for arrays on a device"),
        (lambda x: np.minimum.accumulate(x), "np.minimum.accumulate is not available"),
        (lambda x: np.add([x[0], x[1]], x[2]), "Use np.stack"),
        (lambda x: x.astype(str), "arrays on a device hold numbers"),
        (lambda x: x.sort(), "the method sort() is not available for arrays on a device. Use np.s"),
        (lambda x: x.put([0], 1.0), "the method put() is not available for arrays on a device."),
        (lambda x: x.resize((3, 4)), "the method resize() is not available for arrays on a device"),
        (lambda x: (x > 0).nonzero(), "nonzero() would take"),
        (lambda x: np.sum(x, axis=-1, initial=1.0), "np.sum on a device: "),
        (lambda x: x.__setitem__(np.s_[..., ::-1], x), "Use x[...] = y[..., ::-1]"),
    ],
)
def test_what_leaves_the_protocols_is_refused_with_a_replacement(
    refused: Callable[[Any], Any], message: str
) -> None:
    with pytest.raises(TypeError) as raised:
        refused(_on_device(_X))
    assert message in str(raised.value)


# Methods that arrays and tensors have under one name, on numbers and on a mask.
_METHODS: dict[str, Callable[[Any, Any], Any]] = {
    "all": lambda x, m: m.all(axis=-1),
    "any": lambda x, m: m.any(-1, keepdims=True),
    "argmax": lambda x, m: x.argmax(axis=-1),
    "argmin": lambda x, m: x.argmin(),
    "argsort": lambda x, m: x.argsort(axis=-1),
    "clip": lambda x, m: x.clip(0, 0.5),
    "cumprod": lambda x, m: x.cumprod(axis=-1),
    "cumsum": lambda x, m: x.cumsum() + x.cumsum(axis=0).ravel(),
    "diagonal": lambda x, m: x.diagonal(),
    "dot": lambda x, m: x.dot(np.ones(3)),
    "flatten": lambda x, m: x.flatten(),
    "max": lambda x, m: x.max(0) + x.max(),
    "mean": lambda x, m: x.mean(-1) + m.mean(axis=-1) + x.mean(),
    "min": lambda x, m: x.min(axis=(0, 1)),
    "prod": lambda x, m: x.prod(-1) + x.prod() + x.prod(axis=(0, 1)),
    "ravel": lambda x, m: x.ravel(),
    "repeat": lambda x, m: x.repeat(2) + x.repeat(2, axis=-1).ravel(),
    "reshape": lambda x, m: x.reshape(3, -1).T + x.reshape((4, 3)),
    "round": lambda x, m: (3 * x).round(),
    "squeeze": lambda x, m: x[:, None].squeeze(axis=1),
    "std": lambda x, m: x.std() + x.std(axis=-1) + x.std(0, ddof=1, keepdims=True).max(),
    "sum": lambda x, m: x.sum(axis=-1) + m.sum(-1) + x.sum((0, 1)),
    "swapaxes": lambda x, m: x.swapaxes(0, 1),
    "take": lambda x, m: x.take([3, 0]) + x.take(np.array([1, 2]), axis=-1),
    "trace": lambda x, m: x.trace(),
    "transpose": lambda x, m: x.transpose(),
    "var": lambda x, m: x.var() + x.var(axis=-1) + m.var(axis=-1),
}
# Attributes, and methods that are refused or have no meaning for a task.
_OTHERS = {
    *("T", "conj", "data", "device", "dtype", "imag", "item", "itemsize", "mT", "nbytes", "ndim"),
    *("nonzero", "put", "real", "resize", "shape", "size", "sort", "tolist", "view"),
}


@pytest.mark.parametrize("name", _METHODS)
def test_a_method_that_tensors_have_too_gives_numpys_values(name: str) -> None:
    x = np.random.RandomState(0).uniform(-1, 1, (4, 3)).astype(np.float32)
    expected = _METHODS[name](x, x > 0)
    found = _METHODS[name](_on_device(x), _on_device(x > 0))
    assert tuple(found.shape) == np.shape(expected)
    # float32 in another order of operations; the values are of the order of one.
    np.testing.assert_allclose(as_numpy(found), expected, rtol=1e-5, atol=1e-6)


def test_every_shared_method_is_tested_above() -> None:
    shared = {name for name in dir(np.ndarray) if hasattr(torch.Tensor, name)}
    assert {name for name in shared if not name.startswith("_")} <= set(_METHODS) | _OTHERS


def test_masks_count_as_numbers_beside_numbers() -> None:
    x = np.random.RandomState(0).uniform(-1, 1, (4, 3)).astype(np.float32)

    def compute(x: Any, m: Any) -> list[Any]:
        return [1 - m, m - 1, x - m, np.ones(3) - m, np.subtract(m, x), m @ x.T, np.dot(m, x[0])]

    found = compute(_on_device(x), _on_device(x > 0))
    for ours, theirs in zip(found, compute(x, x > 0), strict=True):
        # float32 beside float64, which NumPy makes of masks; the values are of the order of one.
        np.testing.assert_allclose(as_numpy(ours), theirs, rtol=1e-5, atol=1e-6)
    with pytest.raises(RuntimeError, match="two bool tensors is not supported"):  # nor by NumPy
        _on_device(x > 0) - _on_device(x > 0)


def test_an_ndarray_is_never_changed_in_place() -> None:
    array = _X.copy()
    with pytest.raises(TypeError, match=r"np\.add of an array on a device cannot write into"):
        array += _on_device(_X)
    np.testing.assert_array_equal(array, _X)


def test_elements_are_written_and_views_see_it() -> None:
    array = _on_device(np.zeros((2, 3)))
    row = array[1]
    array[..., 2] = np.ones(2)
    array[0, :2] = np.float64(5.0)
    array[[1], [0]] = 7.0
    array += 1
    np.multiply(array, 2.0, out=array)
    np.testing.assert_array_equal(as_numpy(array), [[12, 12, 4], [16, 2, 4]])
    np.testing.assert_array_equal(as_numpy(row), [16, 2, 4])


@pytest.mark.parametrize(
    "index",
    [
        np.s_[..., ::-1],
        np.s_[::-1],
        np.s_[:, 3:0:-2, None, ::-1],
        np.s_[..., 10:-10:-1],
        np.s_[..., 0:2:-1],
        np.s_[::-1, ..., 1],
        np.s_[:, [3, 0], ::-1],
        np.s_[:, np.array([True, False, True, True]), ::-1],
        np.s_[np.ones((2, 4), bool), ::-1],
    ],
)
def test_slices_go_backwards(index: Any) -> None:
    x = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
    np.testing.assert_array_equal(as_numpy(_on_device(x)[index]), x[index])


def test_numbers_and_constants_of_numpy_keep_float32() -> None:
    array = _on_device(_X)
    constant = np.ones(3)  # float64
    for value in (array * np.float64(2), np.float64(2) * array, constant * array, array - constant):
        assert value.dtype == torch.float32
    assert np.where(array > 0, np.float64(1.0), 0.0).dtype == torch.float32


def test_a_constant_is_copied_to_the_device_once() -> None:
    first = tensors.constant(np.arange(3.0), "cpu")
    assert tensors.constant(np.arange(3.0), "cpu") is first
    assert tensors.constant(np.arange(3), "cpu").dtype == torch.int64


def test_positions_become_an_index_of_the_device() -> None:
    array = _on_device(_X)
    index = arrays.index_for(array, _WHICH)
    assert isinstance(index, torch.Tensor)
    np.testing.assert_array_equal(as_numpy(array[:, index]), _X.astype(np.float32)[:, _WHICH])


def test_users_get_plain_tensors_and_numbers_stay_numbers() -> None:
    array = _on_device(_X)
    assert type(tensors.plain(array)) is torch.Tensor
    assert tensors.plain(array).data_ptr() == array.data_ptr()
    assert tensors.plain(1.5) == 1.5


@pytest.mark.parametrize("sigmoid", sorted(rewards._SIGMOIDS))
def test_every_sigmoid_of_the_rewards_runs(sigmoid: str) -> None:
    x = np.linspace(-3, 3, 41)
    radius = np.linspace(0.1, 1, 41)
    with arrays.rows_of_a_batch(41):
        for bounds, margin in (((0.0, 1.0), 2.0), ((0.0, np.inf), 1.0), ((-np.inf, 0), 0.0)):
            expected = rewards.tolerance(x, bounds, margin, sigmoid)
            found = rewards.tolerance(_on_device(x), bounds, margin, sigmoid)
            np.testing.assert_allclose(as_numpy(found), expected, rtol=1e-4, atol=1e-6)
        expected = rewards.tolerance(x, (0, radius), radius, sigmoid)
        found = rewards.tolerance(
            _on_device(x), (0, _on_device(radius)), _on_device(radius), sigmoid
        )
        np.testing.assert_allclose(as_numpy(found), expected, rtol=1e-4, atol=1e-6)
