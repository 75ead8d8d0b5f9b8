"""Array operations that give the same bits for one simulation and for a batch.

A quantity of one simulation has shape `(...)`; the same quantity of a batch of N has shape
`(N, ...)`. The functions here reduce over the last axis only, and each was chosen because its
result for a row of a batch equals, bit for bit, what dm_control computes for one simulation.

    hand_distance = norm(site_xpos[..., 0, :] - site_xpos[..., 1, :])   # () or (N,)

What they do not do: broadcast a batch against a single simulation, or accept lists.
"""

import contextlib
import contextvars
import functools
from collections.abc import Iterable
from typing import Any, overload

import numpy as np

__all__ = [
    "AnyArray",
    "Quantity",
    "any_of",
    "concat",
    "index_for",
    "minimum_of",
    "norm",
    "one_value_per_row",
    "rotate",
    "rows_of_a_batch",
]

# One number of one simulation, (), or of each simulation of a batch, (N,); or a vector of them.
Quantity = float | np.ndarray

AnyArray = Any  # NumPy's array, or one of another library that speaks NumPy's protocols

_batch_size: contextvars.ContextVar[int | None] = contextvars.ContextVar("batch_size", default=None)


class _RowsOfABatch:
    """See `rows_of_a_batch`; a generator's context would take twice the time."""

    __slots__ = ("_num_envs", "_token")

    def __init__(self, num_envs: int) -> None:
        self._num_envs = num_envs

    def __enter__(self) -> None:
        self._token = _batch_size.set(self._num_envs)

    def __exit__(self, *error: object) -> None:
        _batch_size.reset(self._token)


def rows_of_a_batch(num_envs: int) -> contextlib.AbstractContextManager[None]:
    """Within this context a `(num_envs,)` array is one value per simulation, not a vector.

    Only powers care: see `limberjack.utils.rewards.tolerance`.
    """
    return _RowsOfABatch(num_envs)


def one_value_per_row(x: object) -> bool:
    """Whether `x` holds one value for each simulation of the batch being read."""
    # By its shape, so that arrays that are not ndarrays are recognised as well.
    return getattr(x, "shape", None) == (_batch_size.get(),)


def any_of(mask: np.ndarray) -> bool:
    """Whether any element is true; quicker than `mask.any()`, which batches ask several times."""
    return bool(np.count_nonzero(mask))


def index_for(array: AnyArray, positions: np.ndarray) -> AnyArray:
    """An array of positions in the form that indexes `array` fastest.

    That is NumPy's, unless the array is of another library and its class defines `as_index`, which
    takes the positions to where the array lies, such as a GPU.
    """
    convert = getattr(array, "as_index", None)
    return positions if convert is None else convert(positions)


def norm(x: np.ndarray) -> np.ndarray:
    """Euclidean norm over the last axis, (..., k) -> (...)."""
    if x.ndim == 1:
        return np.sqrt(x.dot(x))
    # Calls the same dot product for each row. A sum of squares, as `np.linalg.norm(axis=-1)` makes,
    # rounds differently wherever the linear algebra library fuses multiplying and adding.
    return np.sqrt(np.vecdot(x, x))


def rotate(vectors: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Row vectors times matrices, (..., k, 3) and (..., 3, 3) -> (..., k, 3).

    With the rotation matrix of a body this expresses world vectors in the body's frame.
    """
    # A stack of single rows: `vectors @ frames` would round differently from `vector.dot(frame)`.
    return np.matmul(vectors[..., None, :], frames[..., None, :, :])[..., 0, :]


def concat(arrays: Iterable[np.ndarray]) -> np.ndarray:
    """Joins arrays along their last axis, (..., k) and (..., m) -> (..., k + m)."""
    return np.concatenate(tuple(arrays), axis=-1)


@overload
def minimum_of(values: Iterable[np.ndarray]) -> np.ndarray: ...


@overload
def minimum_of(values: Iterable[Quantity]) -> Quantity: ...


def minimum_of(values: Iterable[Quantity]) -> Quantity:
    """The smallest of several quantities, element by element, (...) each -> (...)."""
    return functools.reduce(np.minimum, values)
