"""Checks at the door of a batch."""

import threading
from typing import Any

import numpy as np

__all__ = ["OneUser", "at_least_one"]


class OneUser:
    """A context that one thread at a time can be in: the simulations cannot serve two."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.what_is_wrong: str | None = None

    def __enter__(self) -> None:
        if self.what_is_wrong is not None:
            raise RuntimeError(self.what_is_wrong)
        if not self._lock.acquire(blocking=False):
            raise RuntimeError(
                "this batch is used from two threads at once: give each thread a batch of its own"
            )

    def __exit__(self, *error: object) -> None:
        self._lock.release()


def at_least_one(name: str, value: Any) -> int:
    """`value` as an int.

    Raises:
      ValueError: it is no whole number of at least 1.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f"{name} is {value!r}; expected a whole number of at least 1")
    return int(value)
