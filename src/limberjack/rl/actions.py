"""Action checks before a step: actions must be finite numbers.

The task checks the shape; see `limberjack.rl.action_specs` for the spec that agents rely on.
"""

import numpy as np

__all__ = ["as_numbers", "check_finite", "not_finite"]


def as_numbers(action: object) -> np.ndarray:
    """An action, or the actions of many environments, as a numeric array.

    Raises:
      TypeError: the actions are not numbers.
      ValueError: the rows have different lengths.
    """
    try:
        given = np.asarray(action)
    except ValueError as error:
        raise ValueError(f"action is {action!r}; expected an array of numbers") from error
    if given.dtype.kind not in "fiub":
        raise TypeError(f"action has dtype {given.dtype}; expected numbers: {action!r}")
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
