"""`Watch`: notices what the hooks of a task change in the task, its physics and their classes.

    with Watch(task, physics) as watch:
        task.get_reward(physics)
        watch.changed()         # ["self.last_action"]

An assignment counts even if the value is equal. Other changes, such as within a list or an object
that an attribute holds, are found by comparing values. A `functools.cached_property` does
not count. Values that cannot be compared, such as a C library's, go unnoticed.

`QuickWatch` takes a microsecond or two, so that it can watch every hook of every step of a batch.
It notices attributes of one object that were replaced by other objects, and containers whose
elements have changed.

    measured = measurements_of(physics)
    task.get_reward(physics)
    measured            # {"physics.finger_to_target_dist()": 0.21, ...}

Only methods that the physics adds to `mujoco.Physics` are recorded, and only numbers and arrays.
"""

import collections
import functools
import inspect
import operator
import types
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import numpy as np

from limberjack import mujoco
from limberjack.rl.frozen import Frozen
from limberjack.rl.references import ATOMS, attributes_of
from limberjack.utils.turns import Turn

__all__ = ["MEASUREMENT", "RECORDS", "QuickWatch", "Watch", "measurements_of"]

# Classes are changed while a watch is on, so that there is one at a time.
_one_at_a_time = Turn()

_MOST_BYTES = 2**16  # of an array that a `QuickWatch` compares
_NOTHING = object()  # an attribute that is missing
# Attributes of a physics that its own methods set.
_INTERNAL = ("_data", "_simulation", "_warnings_cause_exception", "legacy_step", "named")
_STREAMS = ("_random",)  # of a task; its draws are noticed by the stream's state
_OURS = ("limberjack.", "builtins", "typing", "numpy")  # modules of classes without memory


class Watch:
    """See the module's docstring."""

    def __init__(self, task: object, physics: object, declared: Sequence[str] = ()) -> None:
        """Takes a task, its physics, and the names of attributes that the task may change."""
        self._declared = frozenset(declared)
        self._owners = {"self": task, "physics": physics}
        self._assigned: list[str] = []
        self._patched: list[tuple[type, object]] = []
        inside = getattr(physics, "__dict__", {})
        own = [task, physics, *(inside[name] for name in _INTERNAL if name in inside)]
        self._opaque = {id(one) for one in own}
        self._before: dict[str, object] = {}

    def __enter__(self) -> Self:
        self._lock = _one_at_a_time.lock
        self._lock.acquire()
        try:
            for label, owner in self._owners.items():
                self._record(label, owner)
        except BaseException:
            self.__exit__()
            raise
        self._before = self._values()
        return self

    def __exit__(self, *error: object) -> None:
        for cls, original in reversed(self._patched):
            if original is None:
                del cls.__setattr__
            else:
                cls.__setattr__ = original  # pyright: ignore[reportAttributeAccessIssue]
        self._patched.clear()
        self._lock.release()

    def changed(self) -> list[str]:
        """Sorted names of what was assigned or changed since the last call, or since entering."""
        before, self._before = self._before, self._values()
        assigned, self._assigned[:] = list(self._assigned), []
        names = before.keys() | self._before.keys()
        differing = [n for n in names if before.get(n) != self._before.get(n)]
        return sorted({*assigned, *differing})

    def _record(self, label: str, owner: object) -> None:
        """Makes an object's class record assignments to its attributes."""
        cls: Any = type(owner)  # a user's class
        original = vars(cls).get("__setattr__")
        assign, assigned = cls.__setattr__, self._assigned
        allowed = {*_INTERNAL, *_STREAMS, *(self._declared if label == "self" else ())}

        def recording(one: object, name: str, value: object) -> None:
            if one is owner and name not in allowed:
                assigned.append(f"{label}.{name}")
            assign(one, name, value)

        try:
            cls.__setattr__ = recording
        except (AttributeError, TypeError):  # a class that cannot be changed
            return
        self._patched.append((cls, original))

    def _values(self) -> dict[str, object]:
        found: dict[str, object] = {}
        for label, owner in self._owners.items():
            frozen = Frozen(self._opaque)
            allowed = self._declared if label == "self" else ()
            for name, value in attributes_of(owner).items():
                if name not in allowed and _is_watched(name, value):
                    found[f"{label}.{name}"] = frozen(value)
            for cls in type(owner).__mro__:
                for name in _names_of_values(cls):
                    found[f"{cls.__name__}.{name}"] = frozen(vars(cls)[name])
        return found


def _is_watched(name: str, value: object) -> bool:
    return name not in _INTERNAL and name not in _STREAMS and not hasattr(value, RECORDS)


class QuickWatch:
    """See the module's docstring."""

    def __init__(self, label: str, owner: object, declared: Sequence[str] = ()) -> None:
        """Takes the object, its name in the results, and the attributes that may change."""
        self._label, self._owner = label, owner
        self._declared = frozenset(declared)
        self._names: Sequence[str] = ()
        self._values: list[object] = []
        self._count = -1  # attributes of the object, the declared ones included
        self._containers: list[tuple[str, object]] = []
        self._elements: list[tuple[object, ...]] = []

    def look(self) -> None:
        """Remembers the attributes as they are now."""
        if not self._is_same():
            found = attributes_of(self._owner).items()
            watched = {n: v for n, v in found if n not in self._declared and _is_watched(n, v)}
            self._names, self._values = list(watched), list(watched.values())
            self._count = len(self._attributes)
            self._containers = [(n, v) for n, v in watched.items() if _elements_of(v) is not None]
        self._elements = [_elements_of(value) or () for _, value in self._containers]

    def changed(self) -> list[str]:
        """Sorted names of what has changed since the last look."""
        if not self._containers and self._is_same():  # nearly always
            return []
        elements = zip(self._containers, self._elements, strict=True)
        names = {
            name
            for (name, value), before in elements
            if not _are_same(before, _elements_of(value) or ())
        }
        if not self._is_same():
            before = dict(zip(self._names, self._values, strict=True))
            found = attributes_of(self._owner).items()
            after = {n: v for n, v in found if n not in self._declared and _is_watched(n, v)}
            for name in before.keys() | after.keys():
                if not _are_same((before.get(name, _NOTHING),), (after.get(name, _NOTHING),)):
                    names.add(name)
        return sorted(f"{self._label}.{name}" for name in names)

    @property
    def _attributes(self) -> Mapping[str, object]:
        return getattr(self._owner, "__dict__", {})

    def _is_same(self) -> bool:
        """Whether all attributes are the objects of the last look."""
        attributes = self._attributes
        if len(attributes) != self._count:
            return False
        now = [attributes.get(name, _NOTHING) for name in self._names]
        return all(map(operator.is_, now, self._values))


def _elements_of(value: object) -> tuple[object, ...] | None:
    """Parts of a value that can change while it stays the same object; None if none, or large."""
    if isinstance(value, ATOMS):
        return None
    if isinstance(value, np.ndarray):
        return (value.tobytes(),) if value.nbytes <= _MOST_BYTES else None
    if isinstance(value, Mapping):
        return (*value, *value.values())
    if isinstance(value, list | set | collections.deque):
        return tuple(value)
    return None


def _are_same(before: Sequence[object], after: Sequence[object]) -> bool:
    if len(before) != len(after):
        return False
    return all(a is b or _is_equal_atom(a, b) for a, b in zip(before, after, strict=True))


def _is_equal_atom(one: object, other: object) -> bool:
    return type(one) is type(other) and isinstance(one, ATOMS) and bool(one == other)


def _names_of_values(cls: type) -> Sequence[str]:
    if cls.__module__.startswith(_OURS):
        return ()
    return [
        name
        for name, value in vars(cls).items()
        if not name.startswith(("__", "_abc_")) and not _is_behaviour(value)
    ]


def _is_behaviour(value: object) -> bool:
    """Whether an attribute of a class is a method, a property or a class, instead of a value."""
    return isinstance(value, type | types.FunctionType) or hasattr(type(value), "__get__")


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
