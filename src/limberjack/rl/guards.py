"""Validation of arguments of environments and batches, and `OneUser`."""

import functools
import os
from collections.abc import Iterable, Sequence
from threading import get_ident
from typing import Self

import numpy as np
from dm_env import specs

from limberjack.rl.action_specs import as_numbers, not_finite
from limberjack.utils.seeds import checked_seed, first_of_seeds

__all__ = [
    "OneUser",
    "as_rows",
    "at_least_one",
    "batched_spec",
    "check_actions",
    "check_memory",
    "first_seed",
    "raises_on_divergence",
    "seeds_of_rows",
    "yes_or_no",
]

_STREAM_BYTES = 2_500  # size of a RandomState, with 624 numbers of 4 bytes; each row has two


class OneUser:
    """A context that only one thread at a time may enter, since simulations are not thread-safe.

    Copies, including pickled ones, are independent and unoccupied.
    """

    __slots__ = ("_here", "_name", "enter", "leave", "what_is_wrong")

    def __init__(self, name: str) -> None:
        """Creates a context; `name` is used in messages, such as 'batch'."""
        self._name = name
        self.what_is_wrong: str | None = None
        self._empty()

    def _empty(self) -> None:
        # The id of the thread inside. `setdefault` acquires and records it atomically, so the owner
        # is known wherever Ctrl-C strikes, and that thread can continue.
        user: dict[str, int] = {}
        # Records the given thread id if the context is free; returns the id of the thread inside.
        self.enter = functools.partial(user.setdefault, "thread")
        self.leave = functools.partial(user.pop, "thread", None)
        self._here = _process  # compared by identity; differs in a forked child

    def __enter__(self) -> None:
        self.check()
        here = get_ident()
        if self.enter(here) != here:
            self.refuse(here)

    def __exit__(self, *error: object) -> None:
        self.leave()

    def refuse(self, thread: int) -> None:
        """Raises `RuntimeError` because another thread is inside; after a fork, enters instead.

        Args:
          thread: the id of this thread.
        """
        if self._here is _process:
            raise RuntimeError(
                f"this {self._name} is used from two threads at once: give each thread one of its "
                "own"
            )
        self._empty()
        self.enter(thread)

    def check(self) -> None:
        """Raises `RuntimeError` if the object is no longer usable."""
        if self.what_is_wrong is not None:
            raise RuntimeError(self.what_is_wrong)

    def __reduce__(self) -> tuple[type[Self], tuple[str]]:
        return type(self), (self._name,)


_process: object = object()  # identifies this process; faster to compare than a process id


def _begin_child() -> None:
    global _process
    _process = object()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_child)


def at_least_one(name: str, value: object) -> int:
    """`value` as an int.

    Raises:
      ValueError: the value is not an integer of at least 1.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f"{name} is {value!r}; expected a whole number of at least 1")
    return int(value)


def yes_or_no(name: str, value: object) -> bool:
    """`value` as a bool.

    Raises:
      ValueError: the value is neither True nor False.
    """
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} is {value!r}; expected True or False")
    return bool(value)


def check_memory(num_envs: int, row: Iterable[np.ndarray], more_bytes: int = 0) -> None:
    """Raises MemoryError if the rows cannot fit into this machine's memory.

    Args:
      num_envs: number of rows.
      row: arrays of one row, which are stored at least twice: now and before the last step.
      more_bytes: what a row takes in addition.
    """
    per_row = 2 * sum(array.nbytes for array in row) + 2 * _STREAM_BYTES + more_bytes
    needed, memory = num_envs * per_row, _memory()
    if needed > memory:
        raise MemoryError(
            f"num_envs is {num_envs}, which takes {needed} bytes or more; this machine has {memory}"
        )


def _memory() -> float:
    """This machine's memory, bytes; infinite if unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # Windows has no sysconf
        return float("inf")


def raises_on_divergence(on_divergence: str) -> bool:
    """Whether the option is 'raise' as opposed to 'end'.

    Raises:
      ValueError: the option is neither.
    """
    if on_divergence not in ("end", "raise"):
        raise ValueError(f"on_divergence is {on_divergence!r}; expected 'end' or 'raise'")
    return on_divergence == "raise"


def as_rows(ids: object, num_envs: int) -> np.ndarray:
    """Sorted, unique row numbers from row numbers or a mask of (num_envs,).

    Raises:
      ValueError: the ids have another type, or are out of range, unsorted or repeated.
    """
    rows = np.asarray(ids)
    if rows.dtype == bool:
        if rows.shape != (num_envs,):
            raise ValueError(f"the mask has shape {rows.shape}; expected ({num_envs},)")
        return np.flatnonzero(rows)
    if rows.ndim != 1 or (rows.size and rows.dtype.kind not in "iu"):
        raise ValueError(f"rows are {ids!r}; expected a list of row numbers or a mask")
    if rows.size and (rows.min() < 0 or rows.max() >= num_envs):
        raise ValueError(f"rows are {ids!r}; expected numbers from 0 to {num_envs - 1}")
    rows = rows.astype(int)
    if np.any(np.diff(rows) <= 0):
        raise ValueError(f"rows are {ids!r}; expected sorted numbers without repeats")
    return rows


def first_seed(seed: int | None, count: int) -> int:
    """The seed of the first of several rows; an arbitrary one for None.

    Raises:
      TypeError, ValueError: see `first_of_seeds`.
    """
    return first_of_seeds(np.random.RandomState().randint(2**31) if seed is None else seed, count)


def seeds_of_rows(seeds: Sequence[int | None] | None, count: int) -> list[int | None]:
    """The seed of each row; None for a row that keeps its stream.

    Raises:
      ValueError, TypeError: the number of seeds differs from `count`, or see `checked_seed`.
    """
    if seeds is None:
        return [None] * count
    if isinstance(seeds, str) or not np.iterable(seeds):
        raise TypeError(f"seeds is {seeds!r}; expected a sequence of {count}, one for each row")
    if len(seeds) != count:
        raise ValueError(f"there are {len(seeds)} seeds; expected {count}, one for each row")
    return [None if seed is None else checked_seed(seed) for seed in seeds]


def check_actions(
    actions: object, num_envs: int, begins: np.ndarray, first_row: int = 0
) -> np.ndarray:
    """The actions as an array.

    Args:
      actions: one row of numbers per environment; the task checks the rest of the shape.
      num_envs: number of rows.
      begins: mask of rows that ignore their action, which may then have any value, (num_envs,).
      first_row: the number of the first row in messages.

    Raises:
      TypeError: the actions are not numbers.
      ValueError: the number of rows differs from `num_envs`, or some are NaN or infinite.
    """
    given = as_numbers(actions)
    if given.shape[:1] != (num_envs,):
        raise ValueError(
            f"actions have shape {given.shape}; expected {num_envs} rows, one for each "
            "environment; nothing was stepped"
        )
    bad = not_finite(given)
    if bad is not None:
        rows = np.flatnonzero(bad.reshape(num_envs, -1).any(axis=-1) & ~begins)
        if rows.size:
            named = (rows + first_row).tolist()
            raise ValueError(f"actions are not finite in rows {named}; nothing was stepped")
    return given


def batched_spec(spec: specs.BoundedArray, num_envs: int) -> specs.BoundedArray:
    """The bounded spec with a leading batch axis."""
    shape = (num_envs, *spec.shape)
    minimum, maximum = (np.broadcast_to(bound, shape) for bound in (spec.minimum, spec.maximum))
    return specs.BoundedArray(shape, spec.dtype, minimum, maximum, name=spec.name)
