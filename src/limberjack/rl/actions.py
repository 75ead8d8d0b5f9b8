"""Refusing actions before anything moves."""

from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["as_array", "check_numbers", "not_finite"]


def as_array(action: Any, spec: Callable[[], Any]) -> np.ndarray:
    """The action, or the actions of many environments, as an array.

    Raises:
      ValueError: its rows have different lengths, so that it cannot have the spec's shape.
    """
    try:
        return np.asarray(action)
    except ValueError as error:
        expected = getattr(spec(), "shape", "nested")
        raise ValueError(f"action is {action!r}; expected {expected} numbers") from error


def check_numbers(given: np.ndarray) -> None:
    """Raises if an action, or the actions of many environments, are not finite numbers.

    Raises:
      TypeError: they are not numbers.
      ValueError: some are NaN or infinite.
    """
    if given.dtype.kind not in "fiub":
        raise TypeError(f"action has dtype {given.dtype}; expected numbers: {given!r}")
    bad = not_finite(given)
    if bad is not None:
        where = np.argwhere(bad)
        index = where.ravel() if bad.ndim == 1 else where
        raise ValueError(
            f"action is not finite at index {index.tolist()}: {given}; nothing was stepped"
        )


def not_finite(given: np.ndarray) -> np.ndarray | None:
    """Where numbers are NaN or infinite, as a mask; None if nowhere."""
    if given.dtype.kind != "f":
        return None
    finite = np.isfinite(given)
    # The quickest look at every byte: this runs at every step.
    return ~finite if b"\0" in finite.tobytes() else None
