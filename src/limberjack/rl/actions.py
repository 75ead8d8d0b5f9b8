"""Refusing actions before anything moves: what is not finite numbers.

The shape is the task's affair; see `limberjack.rl.action_specs` for what agents rely on.
"""

import numpy as np

__all__ = ["as_numbers", "check_finite", "not_finite"]


def as_numbers(action: object) -> np.ndarray:
    """The action, or the actions of many environments, as an array of numbers.

    Raises:
      TypeError: they are not numbers.
      ValueError: its rows have different lengths.
    """
    try:
        given = np.asarray(action)
    except ValueError as error:
        raise ValueError(f"action is {action!r}; expected an array of numbers") from error
    if given.dtype.kind not in "fiub":
        raise TypeError(f"action has dtype {given.dtype}; expected numbers: {action!r}")
    return given


def check_finite(given: np.ndarray) -> None:
    """Raises ValueError if numbers of an action are NaN or infinite."""
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
