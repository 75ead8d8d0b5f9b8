"""`EPISODE_ATTRIBUTES`: what a task remembers of an episode, in a single environment.

    class Smooth(base.Task):
        EPISODE_ATTRIBUTES = ("last_action",)

    values_of(task)                     # {"last_action": array([0., 0.])}
    first = values_of(task)             # before its first episode: their dtypes stay
    keep_own(task, ("last_action",), first)    # after a hook: not an array that others change

In a batch each of them is an array with a leading axis of rows; see `rl.episode_attributes`.
"""

import copy
from collections.abc import Mapping

import numpy as np

__all__ = ["NAME", "declared", "in_dtype", "keep_own", "values_of"]

NAME = "EPISODE_ATTRIBUTES"


def declared(task: object) -> tuple[str, ...]:
    """The names that a task declares; empty if it declares none.

    Raises:
      TypeError: it is not a tuple or list of names.
    """
    names = getattr(task, NAME, ())
    if isinstance(names, str) or not isinstance(names, tuple | list):
        wrong = True
    else:
        wrong = not all(isinstance(name, str) for name in names)
    if wrong:
        raise TypeError(
            f"{NAME} of task {type(task).__name__} is {names!r}; expected a tuple of names of "
            "attributes, such as ('last_action',)"
        )
    return tuple(names)


def values_of(task: object) -> dict[str, object]:
    """Copies of the attributes that a task declares and has, by name."""
    names = getattr(task, NAME, ())
    if not isinstance(names, tuple | list):  # such as a mock's, which has any attribute
        return {}
    return {name: copy.copy(getattr(task, name)) for name in names if hasattr(task, name)}


def in_dtype(value: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """The value in a dtype of its kind that has room for it; as it is if that has none."""
    fits = value.dtype.kind == dtype.kind and np.can_cast(value.dtype, dtype)
    return value.astype(dtype, copy=False) if fits else value


def keep_own(task: object, names: object, first: Mapping[str, object]) -> None:
    """Gives a task its own copies of declared arrays, which it may share with a caller or physics.

    A single environment calls it after hooks, so that what is remembered does not change later.
    Numbers take the dtype of their first values, as in a batch: actions may have less precision.

    Args:
      task: the task.
      names: what it declares.
      first: the values from before its first episode, as far as it had any.
    """
    if not isinstance(names, tuple | list):
        return
    for name in names:
        value = getattr(task, name, None)
        if isinstance(value, np.ndarray | np.generic):
            own, before = np.array(value), first.get(name)
            if isinstance(before, np.ndarray | np.generic | int | float):
                own = in_dtype(own, np.asarray(before).dtype)
            setattr(task, name, own if isinstance(value, np.ndarray) else own[()])
