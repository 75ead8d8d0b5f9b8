"""`measurements_of`: what the methods of a task's physics return, recorded as they are called.

    measured = measurements_of(physics)
    task.get_reward(physics)
    measured            # {"physics.finger_to_target_dist()": 0.21, ...}

Only methods that the physics adds to `mujoco.Physics` are recorded, and only numbers and arrays.
"""

import functools
import inspect
import weakref
from collections.abc import Callable

import numpy as np

from limberjack import mujoco

__all__ = ["MEASUREMENT", "RECORDS", "measurements_of"]

MEASUREMENT = "physics."  # every label begins with it
RECORDS = "records_measurements"  # an attribute of the functions that take the methods' place


def measurements_of(physics: object) -> dict[str, np.ndarray]:
    """A dictionary that each later call of a method adds its result to.

    Args:
      physics: a `mujoco.Physics`, whose methods are replaced by recording ones.
    """
    measured: dict[str, np.ndarray] = {}
    # Weak, as otherwise the physics would refer to itself, and its memory be freed late.
    itself = weakref.ref(physics)
    for name, function in inspect.getmembers(type(physics), inspect.isfunction):
        if not hasattr(mujoco.Physics, name):
            vars(physics)[name] = _recording(name, function, itself, measured)
    return measured


def _recording(
    name: str,
    function: Callable[..., object],
    physics: weakref.ref[object],
    measured: dict[str, np.ndarray],
) -> Callable[..., object]:
    @functools.wraps(function)
    def call(*args: object, **kwargs: object) -> object:
        one = physics()
        value = inspect.getattr_static(type(one), name).__get__(one)(*args, **kwargs)
        if isinstance(value, np.ndarray | np.number | np.bool | float | int):
            label, number = f"{MEASUREMENT}{name}()", 1
            while label in measured:
                number += 1
                label = f"{MEASUREMENT}{name}(), call {number},"
            measured[label] = np.array(value)  # a copy: it may be a view of live memory
        return value

    setattr(call, RECORDS, True)
    return call
