"""Independent copies of environments, and a check that copies share no state.

    difference(env)       # "its class Half overrides step"; None for a plain `control.Environment`
    check_copies(env)     # raises TypeError if a copy with another seed would share its state
    other = copied(env)   # continues as `env` does, bit for bit

A plain environment can be seeded. Any other may keep state in any attribute, so a copy of it copies
them all. `copy.deepcopy` does not copy functions, nor what they refer to: a copy of an
environment whose `step` is `lambda a: old(a)` would step the original.
"""

import copy
import functools
import types
import weakref
from typing import Any, TypeVar

import dm_env

from limberjack.rl.references import (
    ATOMS,
    STREAMS,
    Assigned,
    attributes_of,
    counts_in_closure,
    is_live,
    kept_by,
    local_methods,
    reachable,
    reaches,
)

__all__ = ["check_copies", "control_of", "copied", "difference", "exact_copies", "set_plain"]

_FUNCTIONS = (types.FunctionType, types.BuiltinFunctionType, types.MethodWrapperType)
_FUNCTIONS += (functools.partial, staticmethod, classmethod)
_PROTOCOL = 4  # of pickle, which `copy.deepcopy` uses too
_ITERATORS = (types.GeneratorType, types.CoroutineType, types.AsyncGeneratorType)

_Env = TypeVar("_Env")


# The class `control.Environment`, and the attributes of its instances. That module sets them, since
# it imports this one.
_plain: tuple[type, frozenset[str]] = (dm_env.Environment, frozenset())


# Classes that override nothing, and their attributes when that was found.
_not_overriding: "weakref.WeakKeyDictionary[type, Assigned]" = weakref.WeakKeyDictionary()


def set_plain(cls: type, attributes: frozenset[str]) -> None:
    """Sets the class of plain environments, and the names of the attributes that these have."""
    global _plain
    _plain = cls, attributes


def difference(env: object) -> str | None:
    """The first difference from a plain `control.Environment`, as a clause; None if there is none.

    Differences are overridden or replaced methods and additional attributes, but not additional
    methods.
    """
    plain, attributes = _plain
    cls = type(env)
    if not isinstance(env, plain):
        return f"it is a {cls.__name__}, not a control.Environment"
    known = _not_overriding.get(cls)
    if known is None or not known.is_same():
        overridden = _overridden(cls, plain)
        if overridden is not None:
            return overridden
        _not_overriding[cls] = Assigned(cls)
    inside = vars(env)
    for name in inside.keys() - attributes:
        value = inside[name]
        if callable(value) and hasattr(cls, name):
            return f"its method {name} is replaced"
        return f"it has an attribute {name!r} of its own"
    return None


def _overridden(cls: type, base: type) -> str | None:
    for one in cls.__mro__:
        for name, value in vars(one).items():
            if one is base:
                scope = getattr(value, "__globals__", None)
                if scope is not None and scope.get("__name__") != base.__module__:
                    return f"{base.__name__}.{name} is replaced"
            elif name == "__getattr__" or (name not in _NOT_BEHAVIOUR and hasattr(base, name)):
                return f"its class {one.__name__} overrides {name}"
        if one is base:
            return None
    return None


_NOT_BEHAVIOUR = {
    *vars(type("Empty", (), {})),
    *("__init__", "__annotations__", "__annotate__", "__annotate_func__", "__parameters__"),
    *("__orig_bases__", "__firstlineno__", "__static_attributes__", "__abstractmethods__"),
    *("_abc_impl", "__repr__", "__str__", "__annotations_cache__"),
}


def control_of(env: object) -> object | None:
    """The innermost `control.Environment`, with a task and a physics; None if there is none.

    Wrappers have it in an attribute of any name.
    """
    plain, _ = _plain
    todo, seen = [env], set()
    while todo:
        one = todo.pop(0)
        if id(one) in seen:
            continue
        seen.add(id(one))
        inside = getattr(one, "__dict__", {})
        if isinstance(one, plain) and "_task" in inside:
            return one
        todo += [value for value in inside.values() if isinstance(value, dm_env.Environment)]
    return None


def copied(env: _Env) -> _Env:
    """A copy that continues bit for bit as the environment would."""
    memo: dict[int, object] = {}
    exact_copies(env, memo)
    return copy.deepcopy(env, memo)


def exact_copies(env: object, memo: dict[int, object]) -> None:
    """Adds exact copies of the physics and wrappers within an environment to a deep copy's memo.

    A copied physics alone recomputes its quantities, as in dm_control, which changes the solver's
    warm start. A wrapper that delegates all names delegates `__deepcopy__` too, so that
    `copy.deepcopy` would return a copy of what it wraps.
    """
    wrappers: list[tuple[object, object]] = []  # copies, and the states that they get
    for _, value in reachable(env):
        if id(value) in memo:
            continue
        kind: Any = type(value)  # a Physics, whose module imports this one
        if hasattr(kind, "become") and "_simulation" in vars(value):
            memo[id(value)] = twin = kind.__new__(kind)
            twin.become(copy.deepcopy(value.__getstate__(), memo))
        elif isinstance(value, dm_env.Environment) and not hasattr(kind, "__deepcopy__"):
            make, arguments, state, *_ = kind.__reduce_ex__(value, _PROTOCOL)
            memo[id(value)] = twin = make(*copy.deepcopy(arguments, memo))
            wrappers.append((twin, state))
    for twin, state in wrappers:
        _set_state(twin, copy.deepcopy(state, memo))


def _set_state(one: object, state: Any) -> None:  # of any type: as a user's class reduces
    """Sets the state of an object as `copy.deepcopy` does."""
    set_state = getattr(type(one), "__setstate__", None)
    if set_state is not None:
        set_state(one, state)
        return
    in_dict, in_slots = state if isinstance(state, tuple) and len(state) == 2 else (state, None)
    vars(one).update(in_dict or {})
    for name, value in (in_slots or {}).items():
        object.__setattr__(one, name, value)


def check_copies(env: object, are_seeded: bool = True, is_vectorised: bool = False) -> None:
    """Raises TypeError if copies of an environment would not be independent.

    The message names the attribute, and asks for a function that makes the environment.

    Args:
      env: the environment.
      are_seeded: whether each copy gets a seed of its own, which sets the task's stream only.
      is_vectorised: whether the one copy is to be vectorised, which compares its values.
    """
    inner = control_of(env)
    task, physics = getattr(inner, "_task", None), getattr(inner, "_physics", None)
    stream = getattr(task, "_random", getattr(task, "random", None))
    own = [env, inner, task, physics, stream, *getattr(physics, "__dict__", {}).values()]
    targets = {id(one) for one in own if one is not None and not isinstance(one, (*ATOMS, type))}
    # Copies of these would not belong to the copied physics.
    parts = [getattr(physics, "model", None), getattr(physics, "data", None)]
    # Not `ptr`, which would give a shared model's wrapper a copy of its own.
    official = [getattr(parts[0], "_official", None), getattr(parts[1], "_data", None)]
    views = {id(one) for one in (parts[0], *official) if one is not None}
    for path, value in reachable(env):
        if id(value) in views and not is_vectorised:
            raise _refused(env, path, f"is the {type(value).__name__} of its physics: keep physics")
        may_share = is_vectorised or "_ours.randomizer" in path
        why = _why_shared(value, targets, may_share)
        if why is not None:
            raise _refused(env, path, why)
        if are_seeded and isinstance(value, STREAMS) and value is not stream:
            bit_generator = getattr(stream, "_bit_generator", None)
            if value is not bit_generator:
                raise _refused(env, path, "is a random stream other than the task's")
    try:
        if is_vectorised:  # one task for all rows, which keeps to its physics
            copy.deepcopy(task, {id(one): one for one in (env, inner, physics)})
        else:
            copied(env)
    except Exception as error:  # of any class: it is the user's object
        name = _cannot_be_copied(env)
        raise _refused(env, name, f"cannot be copied ({type(error).__name__}: {error})") from error


def _why_shared(value: object, targets: set[int], may_share: bool) -> str | None:
    """Why a deep copy of a value would share something with the original; None if it would not."""
    if isinstance(value, _ITERATORS):
        return f"is a {type(value).__name__}, which cannot be copied"
    if not may_share and is_live(value):
        return "shows the memory of its simulation, which a copy would not: keep physics"
    if isinstance(value, _FUNCTIONS):
        if reaches(value, targets):
            return "is a function that uses the environment itself"
        kept = None if may_share else kept_by(value)
        if kept is not None:
            return f"is a function that keeps {kept}, which copies would share"
    elif isinstance(value, weakref.ref | type) and reaches(value, targets):
        return "refers to the environment itself"
    if any(reaches(one, targets) for one in local_methods(value)):
        return f"is a {type(value).__name__}, whose class uses the environment itself"
    if not may_share and counts_in_closure(value):
        return f"is a {type(value).__name__}, whose class assigns to variables of a function"
    return None


def _refused(env: object, path: str, why: str) -> TypeError:
    what = f"attribute {path}" if path else "state"
    return TypeError(
        f"this {type(env).__name__} cannot be copied for a batch or a snapshot: its {what} {why}; "
        "pass a function build(seed) that makes the environment instead"
    )


def _cannot_be_copied(env: object) -> str:
    """The first attribute that cannot be copied alone; empty if each can."""
    inner = control_of(env)
    owners = [("", env), ("task.", getattr(inner, "_task", None))]
    for prefix, owner in owners:
        for name, value in attributes_of(owner).items():
            if name in ("_task", "_physics") or isinstance(value, dm_env.Environment):
                continue
            try:
                copy.deepcopy(value)
            except Exception:  # of any class: it is the user's object
                return f"{prefix}{name}"
    return ""
