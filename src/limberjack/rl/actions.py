"""Action checks before a step: actions must be finite numbers.

The task checks the shape; see `limberjack.rl.action_specs` for the spec that agents rely on.
"""

import math
import reprlib

import numpy as np

__all__ = ["as_numbers", "check_finite", "in_shape", "not_finite"]


_WIDEST = np.dtype(np.float64).itemsize  # bytes


def as_numbers(action: object) -> np.ndarray:
    """An action, or the actions of many environments, as a numeric array.

    Types wider than MuJoCo's float64 become float64, in which their largest values are infinite;
    others keep their type, since they convert without loss or overflow.

    Raises:
      TypeError: the actions are not real numbers, or Python integers beyond 64 bits.
      ValueError: the rows have different lengths, or an integer is beyond the range of float64.
    """
    try:
        given = np.asarray(action)
    except ValueError as error:
        raise ValueError(f"action is {action!r}; expected an array of numbers") from error
    except OverflowError as error:
        raise ValueError(
            f"action is {reprlib.repr(action)}; expected numbers within the range of float64; "
            "nothing was stepped"
        ) from error
    if given.dtype.kind not in "fiub":
        raise TypeError(
            f"action has dtype {given.dtype}; expected numbers: {reprlib.repr(action)}; nothing "
            "was stepped"
        )
    if given.dtype.itemsize <= _WIDEST:
        return given
    with np.errstate(all="ignore"):  # overflow: the result is checked instead
        return given.astype(np.float64)


def in_shape(given: np.ndarray, shape: tuple[int, ...], num_rows: int = 1) -> np.ndarray:
    """The numbers in the shape of their spec; one for one actuator of each row may have any shape.

    Raises:
      ValueError: they have another shape.
    """
    if given.size == math.prod(shape) == num_rows:
        return given.reshape(shape)
    if given.shape != shape:
        raise ValueError(
            f"action has shape {given.shape}; expected {shape}, one number for each actuator; "
            "nothing was stepped"
        )
    return given


def check_finite(given: np.ndarray) -> None:
    """Raises ValueError if an action contains NaN or infinity."""
    bad = not_finite(given)
    if bad is not None:
        where = np.argwhere(bad)
        index = where.ravel() if bad.ndim == 1 else where
        raise ValueError(
            f"action is not finite at index {index.tolist()}: {given}; nothing was stepped"
        )


def not_finite(given: np.ndarray) -> np.ndarray | None:
    """Mask of NaN and infinite elements; None if there are none."""
    if given.dtype.kind != "f":
        return None
    finite = np.isfinite(given)
    # Runs at every step; searching the bytes is the fastest check.
    return ~finite if b"\0" in finite.tobytes() else None
