"""Memory of an episode: attributes that a task or its physics keeps between calls.

    before = remembered(task, physics)      # deep copies, by owner and name
    ...
    put_back(before, task, physics)

The suite's tasks keep nothing: everything about an episode is in the simulation, and their memory
is empty. Another task may keep a last action, a counter or a queue. Snapshots contain such
attributes, and a reset with a seed puts them back. The task's random stream is saved separately.
"""

import contextlib
import copy
import dataclasses
import functools
import types
import weakref
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import dm_env
import numpy as np

from limberjack.rl.references import (
    ATOMS,
    Assigned,
    attributes_of,
    cached_of,
    counts_in_closure,
    is_live,
    kept_by,
    reachable,
    reaches,
)

__all__ = [
    "Memory",
    "is_of_the_suite",
    "put_back",
    "remembered",
    "stand_in",
]

# Classes of the suite whose functions were all found to be this package's.
_unchanged: dict[type, Assigned] = {}

# Attributes by name, of the "task" and of the "physics".
Memory = Mapping[str, Mapping[str, object]]

_OURS = "limberjack."
_SUITE = "limberjack.suite."
_STREAMS = ("_random", "random")  # names of a task's own stream
_DECORATORS = ("contextlib", "functools")  # whose functions replace the ones they decorate
_SETTINGS = ("legacy_step", "_warnings_cause_exception")  # of a physics, not of an episode

_Task = TypeVar("_Task")


def is_of_the_suite(task: object, physics: object) -> bool:
    """Whether both are the suite's own, with no method of class or instance replaced."""
    return _is_unchanged(task) and _is_unchanged(physics)


def remembered(task: object, physics: object) -> Memory:
    """Deep copies of the attributes of a task and its physics, except for the task's stream.

    They are copied together, so that shared objects stay shared. References to the task and the
    physics themselves become those of the environment that gets them. Empty for the suite's own
    tasks.

    Raises:
      TypeError: an attribute cannot be copied, or a copy would not be complete; the message names
        it.
    """
    if is_of_the_suite(task, physics):
        return {}
    kept = _kept(task, physics)
    _check_complete(kept, task, physics)
    memo: dict[int, object] = {  # in which others stand for the parts of the environment
        id(one): _own(name) for name, one in _parts_of(task, physics).items()
    }
    copies: dict[str, dict[str, object]] = {}
    for owner, attributes in kept.items():
        copies[owner] = {}
        for name, value in attributes.items():
            try:
                copies[owner][name] = copy.deepcopy(value, memo)
            except Exception as error:  # of any class: it is the user's object
                cls = type(task if owner == "task" else physics).__name__
                raise TypeError(
                    f"attribute {name!r} of {owner} {cls} cannot be copied "
                    f"({type(error).__name__}: {error}), but copies, snapshots and batches "
                    "contain it: keep only values that copy.deepcopy supports"
                ) from error
    return copies


def _check_complete(
    kept: Mapping[str, Mapping[str, object]], task: object, physics: object
) -> None:
    """Raises TypeError if copies of attributes would share or lose what they keep."""
    own = _ids_of(task, physics)
    for one in (task, physics):
        if counts_in_closure(one):
            raise TypeError(
                f"class {type(one).__name__} assigns to variables of the function that defines it, "
                "which copies would share: keep them in attributes of the task, so that copies and "
                "snapshots contain them"
            )
    for owner, attributes in kept.items():
        for name, value in attributes.items():
            why = _why_incomplete(value, own, physics)
            if why is not None:
                cls = type(task if owner == "task" else physics).__name__
                raise TypeError(
                    f"attribute {name!r} of {owner} {cls} {why}, which a copy would not: keep "
                    "it in an attribute of the task, so that copies and snapshots contain it"
                )


def _why_incomplete(value: object, own: set[int], physics: object) -> str | None:
    """The reason why a copy of a value would share or lose something; None without one."""
    if id(value) in own:
        return None
    for _, part in reachable(value):
        if (keeping := kept_by(part, own)) is not None:
            return f"is a function that keeps {keeping}"
        if isinstance(part, weakref.ref):
            return "is a weak reference"
        if is_live(part) or part is getattr(physics, "model", None):
            return "shows the memory of the simulation"
    return None


def put_back(memory: Memory, task: object, physics: object) -> None:
    """Sets the attributes to copies of remembered ones, and removes others.

    Args:
      memory: the result of `remembered`, or a part of it.
      task: the task.
      physics: its physics.
    """
    if not memory:
        return
    parts = _parts_of(task, physics)
    memo = {
        # A physics makes some parts, such as `named`, on their first use.
        id(one): parts[name] if name in parts else getattr(physics, name.rpartition(".")[2], None)
        for name, one in _OWN.items()
    }
    memory = copy.deepcopy(dict(memory), memo)
    for key, owner in (("task", task), ("physics", physics)):
        attributes = memory.get(key, {})
        for name in _kept(task, physics)[key]:
            if name not in attributes:
                delattr(owner, name)
        for name, value in attributes.items():
            # Not through a property or a `__setattr__` of the class, which may do more.
            object.__setattr__(owner, name, value)


@contextlib.contextmanager
def stand_in(task: _Task, physics: object) -> Iterator[_Task]:
    """A context in which calls of a task leave no trace in it, its stream or the simulation.

    What cannot be copied, and a function in the place of a method, is used itself. The suite's own
    tasks remember nothing.
    """
    if is_of_the_suite(task, physics):
        yield task
        return
    kept = {id(owner): dict(attributes) for owner, attributes in _owned(task, physics)}
    stay = (task, physics, *getattr(physics, "__dict__", {}).values())
    memo: dict[int, object] = {id(one): one for one in stay}
    # Any: a physics of MuJoCo has it.
    simulation: Any = getattr(physics, "simulation", None)
    state = b"" if simulation is None else simulation.get_state(simulation.WHOLE)
    try:
        for owner, attributes in _owned(task, physics):
            methods = set(_shadowed(type(owner), attributes))
            values = {name: x for name, x in attributes.items() if name not in methods}
            for name, value in _copies_of(values, memo).items():
                object.__setattr__(owner, name, value)
        yield task
    finally:
        for owner, attributes in _owned(task, physics):
            for name in attributes.keys() - kept[id(owner)].keys():
                delattr(owner, name)
            for name, value in kept[id(owner)].items():
                object.__setattr__(owner, name, value)
        if simulation is not None:
            now = simulation.get_state(simulation.WHOLE)
            if bytes(now) != bytes(state):
                simulation.set_state(state, simulation.WHOLE)


def _owned(task: object, physics: object) -> list[tuple[object, dict[str, object]]]:
    """The task and its physics, each with its attributes."""
    return [(task, attributes_of(task)), (physics, _of_physics(physics))]


def _copies_of(attributes: Mapping[str, object], memo: dict[int, object]) -> dict[str, object]:
    """Deep copies of attributes; an attribute that cannot be copied is kept itself."""
    found = {}
    for name, value in attributes.items():
        try:
            found[name] = copy.deepcopy(value, memo)
        except Exception:  # of any class: it is the user's object
            found[name] = value
    return found


def _kept(task: object, physics: object) -> dict[str, dict[str, object]]:
    """The attributes by owner, without the task's stream.

    Functions that use their owners stay with them.
    """
    own = _ids_of(task, physics)
    of_task = {n: v for n, v in attributes_of(task).items() if not _is_stream(n, v)}
    # A cached property that shows the simulation is computed again.
    cached = cached_of(task).items()
    of_task |= {n: v for n, v in cached if _why_incomplete(v, own, physics) is None}
    kept = {"task": of_task, "physics": _of_physics(physics)}
    return {
        owner: {name: one for name, one in attributes.items() if not _uses(one, own)}
        for owner, attributes in kept.items()
    }


def _uses(value: object, own: set[int]) -> bool:
    """Whether a value is a function that uses the task or the physics, and keeps nothing else."""
    if not isinstance(value, types.FunctionType | functools.partial):
        return False
    return reaches(value, own) and kept_by(value, own) is None


def _ids_of(task: object, physics: object) -> set[int]:
    """Ids of the task, its stream, its physics and the parts of the physics."""
    return {id(one) for one in _parts_of(task, physics).values()}


def _of_physics(physics: object) -> dict[str, object]:
    """The attributes that a class of physics, or its user, has added.

    Not views of its own memory, which always show the present.
    """
    added = attributes_of(physics).items()
    return {n: value for n, value in added if n not in _SETTINGS and not is_live(value)}


def _is_stream(name: str, value: object) -> bool:
    return name in _STREAMS and isinstance(value, np.random.RandomState)


class _Own:
    """Stands for a part of an environment, in what is remembered of it."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __reduce__(self) -> tuple[object, ...]:
        return _own, (self.name,)

    def __getattr__(self, name: str) -> "_OwnMethod":
        if name.startswith("__"):
            raise AttributeError(name)
        return _OwnMethod(self, name)  # a pickled method, as Python looks it up


@dataclasses.dataclass(frozen=True)
class _OwnMethod:
    """Stands for a method of a part."""

    owner: _Own
    name: str

    def __deepcopy__(self, memo: dict[int, object]) -> object:
        return getattr(copy.deepcopy(self.owner, memo), self.name)


_OWN: dict[str, _Own] = {}  # by name


def _own(name: str) -> _Own:
    """The only one of this name."""
    return _OWN.setdefault(name, _Own(name))


def _parts_of(task: object, physics: object) -> dict[str, object]:
    """The task, its stream, its physics and the parts of that, by name."""
    added = _of_physics(physics)
    inside = getattr(physics, "__dict__", {})
    parts = {f"physics.{name}": one for name, one in inside.items() if name not in added}
    parts |= {"task": task, "physics": physics, "stream": getattr(task, "_random", None)}
    for one in attributes_of(task).values():
        if isinstance(one, dm_env.Environment) and getattr(one, "_task", None) is task:
            parts["environment"] = one
    is_part = {
        name: not isinstance(one, ATOMS) and type(one) is not tuple for name, one in parts.items()
    }
    return {name: one for name, one in parts.items() if is_part[name]}


def _is_unchanged(owner: object) -> bool:
    cls = type(owner)
    known = _unchanged.get(cls)
    if known is None or not known.is_same():
        if not cls.__module__.startswith(_SUITE):
            return False
        ours = [one for one in cls.__mro__ if one.__module__.startswith(_OURS)]
        if not all(_is_defined_here(one) for one in ours):
            return False
        known = _unchanged[cls] = Assigned(cls)
    attributes = vars(owner)
    shadowing = attributes.keys() & known.names
    return not any(_shadowed(cls, {name: attributes[name] for name in shadowing}))


def _shadowed(cls: type, attributes: Mapping[str, object]) -> Iterator[str]:
    """Names of methods that an instance replaces."""
    for name, value in attributes.items():
        if callable(value) and callable(getattr(cls, name, None)):
            yield name


def _is_defined_here(cls: type) -> bool:
    """Whether all functions of a class are this package's, not ones that a user has assigned."""
    for value in vars(cls).values():
        function = getattr(value, "__func__", getattr(value, "fget", value))
        scope = getattr(function, "__globals__", None)
        name = "" if scope is None else str(scope.get("__name__"))
        if name and not name.startswith(_OURS) and name not in _DECORATORS:
            return False
    return True
