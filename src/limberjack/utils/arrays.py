"""Array operations with bitwise equal results for a single simulation and for each batch row.

A quantity of one simulation has shape `(...)`; the same quantity in a batch of N has shape
`(N, ...)`. The functions reduce over the last axis only, and each was chosen because its result
for a row of a batch equals, bit for bit, dm_control's result for one simulation.

    hand_distance = norm(site_xpos[..., 0, :] - site_xpos[..., 1, :])   # () or (N,)

They do not broadcast a batch against a single simulation, and they do not accept lists.
"""

import contextlib
import contextvars
import functools
import threading
from collections.abc import Iterable
from typing import overload

import numpy as np

__all__ = [
    "Quantity",
    "any_of",
    "concat",
    "index_for",
    "mean",
    "minimum_of",
    "norm",
    "one_value_per_row",
    "rows_of_a_batch",
    "squared_norm",
    "to_frame",
]

# A scalar per simulation, () or (N,), or a vector per simulation, (k,) or (N, k).
Quantity = float | np.ndarray

# The number of rows of the last batch whose context was entered, the lock that is held within that
# context, and the context around it.
_Entered = tuple[int, threading.Lock, "_Entered | None"]
_entered: contextvars.ContextVar[_Entered | None] = contextvars.ContextVar("entered", default=None)


def rows_of_a_batch(num_envs: int) -> contextlib.AbstractContextManager[object]:
    """Context in which a `(num_envs,)` array holds one value per simulation, not a vector.

    Only powers depend on it: see `limberjack.utils.rewards.tolerance`.
    """
    # A lock, because Ctrl-C can strike in no method of it: the context ends wherever it strikes.
    lock = threading.Lock()
    _entered.set((num_envs, lock, _batch()))
    return lock


def _batch() -> _Entered | None:
    """The innermost batch in whose context this code runs."""
    found = _entered.get()
    while found is not None and not found[1].locked():
        found = found[2]
    return found


def one_value_per_row(x: object) -> bool:
    """Whether `x` holds one value per simulation of the current batch."""
    batch = _batch()
    # Checks the shape only, so that arrays of other libraries are recognised too.
    return batch is not None and getattr(x, "shape", None) == (batch[0],)


def any_of(mask: np.ndarray) -> bool:
    """Whether any element is true; faster than `mask.any()`, and used several times per step."""
    return bool(np.count_nonzero(mask))


def index_for(array: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """The positions in the form that indexes `array` fastest.

    This is `positions` itself for NumPy; an array class of another library may define `as_index`,
    which moves the positions to the array's device, such as a GPU.
    """
    convert = getattr(array, "as_index", None)
    return positions if convert is None else convert(positions)


def mean(x: np.ndarray) -> np.ndarray:
    """Mean over the last axis, (..., k) -> (...): the bits of `ndarray.mean`, in half its time."""
    return np.add.reduce(x, axis=-1) / x.shape[-1]


def norm(x: np.ndarray) -> np.ndarray:
    """Euclidean norm over the last axis, (..., k) -> (...)."""
    return np.sqrt(squared_norm(x))


def squared_norm(x: np.ndarray) -> np.ndarray:
    """Sum of squares over the last axis, (..., k) -> (...)."""
    # The same dot product for each row. A sum of squares, as in `np.linalg.norm(axis=-1)`, rounds
    # differently wherever the linear algebra library fuses multiplication and addition.
    return x.dot(x) if x.ndim == 1 else np.vecdot(x, x)


def to_frame(vectors: np.ndarray, xmat: np.ndarray) -> np.ndarray:
    """World vectors in the frame of a body, geom or site.

    Args:
      vectors: (..., 3), or (..., k, 3) for several of each simulation.
      xmat: the frame as a row of MuJoCo's `xmat`, (..., 9).

    Returns:
      An array of the shape of `vectors`.
    """
    frames = xmat.reshape(*xmat.shape[:-1], 3, 3)
    if vectors.ndim == 1 == xmat.ndim:
        return vectors.dot(frames)
    if vectors.ndim > xmat.ndim:
        frames = frames[..., None, :, :]
    # A stack of single rows: `vectors @ frames` would round differently from `vector.dot(frame)`.
    return np.matmul(vectors[..., None, :], frames)[..., 0, :]


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
