"""References between objects, and the ones that a deep copy would leave shared.

    for path, value in reachable(environment):
        ...                                 # "_task.get_reward", <function>
    reaches(function, {id(environment)})    # through a closure, a default, a global, an attribute
    kept_by(function)                       # "a list in its closure"; None if it keeps nothing

`copy.deepcopy` copies neither functions, methods of built-in objects and weak references, nor the
objects they refer to; and a copy of an array that views a simulation's memory no longer follows it.
"""

import collections
import dis
import functools
import gc
import random
import sys
import types
import weakref
from collections.abc import Container, Iterable, Iterator, Mapping

import numpy as np

__all__ = [
    "ATOMS",
    "STREAMS",
    "Assigned",
    "attributes_of",
    "cached_of",
    "cells_of",
    "counts_in_closure",
    "is_live",
    "kept_by",
    "local_methods",
    "reachable",
    "reaches",
]

ATOMS = (str, bytes, int, float, complex, bool, type(None), types.ModuleType, range, np.generic)
STREAMS = (np.random.RandomState, np.random.Generator, np.random.BitGenerator, random.Random)

_MOST_OBJECTS = 100_000  # of a search; an environment with more holds data, not functions
_INTERNAL = "limberjack.mujoco."  # objects without references to a user's
# Of an environment: streams made from the task's, and what each copy makes for itself.
_NOT_COPIED = ("_ours.seeded", "_ours.draws", "_ours.use")
_C_MODULES = ("builtins", "itertools", "functools", "operator", "_operator", "collections")
# Modules of views into a simulation, and the classes in them whose copies are complete.
_PARTS_OF_SIMULATIONS = ("mujoco._structs", "limberjack.mujoco.index")
_WHOLE = ("MjModel", "MjData", "MjSpec", "MjvOption", "MjvCamera", "MjvPerturb", "MjLROpt")
_WRITES = ("STORE_DEREF", "STORE_SUBSCR", "STORE_ATTR", "DELETE_DEREF", "DELETE_SUBSCR")


class Assigned:
    """The attributes of a class and of its bases, to notice assignments to them.

    Attributes:
      names: of the attributes.
    """

    def __init__(self, cls: type) -> None:
        classes = [one for one in cls.__mro__ if one is not object]
        self._values = [(vars(one), tuple(vars(one).values())) for one in classes]
        self.names = frozenset(name for one in classes for name in vars(one))

    def is_same(self) -> bool:
        """Whether no attribute was added, removed or changed to an unequal value since."""
        try:
            # Tuples compare identities first, in C, which matters as each snapshot asks.
            return all(tuple(now.values()) == values for now, values in self._values)
        except ValueError:  # the comparison of two different arrays has no single truth value
            return False


def attributes_of(owner: object) -> dict[str, object]:
    """The attributes of an object by name, in `__dict__` or in slots; not cached properties.

    Of a physics, only the attributes that its own class, or its user, has added.
    """
    own: Mapping[str, object] = getattr(owner, "__dict__", {})
    if _is_physics(owner):
        return owner._shared_attributes()  # pyright: ignore[reportAttributeAccessIssue] (as checked)
    cached, slots = _declared_by(type(owner))
    found = {name: value for name, value in own.items() if name not in cached}
    found |= {name: getattr(owner, name) for name in slots if hasattr(owner, name)}
    return found


def cached_of(owner: object) -> dict[str, object]:
    """The values that cached properties of an object have kept, by name."""
    cached, _ = _declared_by(type(owner))
    return {name: one for name, one in vars(owner).items() if name in cached}


@functools.lru_cache(maxsize=256)
def _declared_by(cls: type) -> tuple[frozenset[str], tuple[str, ...]]:
    """Names of the cached properties and of the slots of a class."""
    cached, slots = set(), []
    for one in cls.__mro__:
        cached |= {n for n, v in vars(one).items() if isinstance(v, functools.cached_property)}
        own = vars(one).get("__slots__", ())
        slots += [own] if isinstance(own, str) else own
    slots = [name for name in slots if name not in ("__dict__", "__weakref__")]
    return frozenset(cached), tuple(slots)


def _is_physics(value: object) -> bool:
    # By its class, because a mock has any attribute.
    return "_simulation" in getattr(value, "__dict__", {}) and hasattr(
        type(value), "_shared_attributes"
    )


def reachable(root: object) -> Iterator[tuple[str, object]]:
    """Objects that an environment holds, each once, with the attribute that leads to it.

    Functions are included, but not what they refer to.
    """
    seen: set[int] = set()
    kept: list[object] = []  # so that no id is used twice
    todo: collections.deque[tuple[str, object]] = collections.deque([("", root)])
    while todo and len(seen) < _MOST_OBJECTS:
        path, value = todo.popleft()
        if isinstance(value, ATOMS) or id(value) in seen:
            continue
        if _is_global(value) and not isinstance(value, types.FunctionType | type):
            continue  # a module's own, such as a function of NumPy
        seen.add(id(value))
        kept.append(value)
        yield path, value
        if not isinstance(value, types.FunctionType | type):
            todo.extend(_parts(path, value))


def reaches(value: object, targets: set[int]) -> bool:
    """Whether an object refers to one of others, given by id, also through functions."""
    seen: set[int] = set()
    kept: list[object] = []
    todo = [value]
    while todo and len(seen) < _MOST_OBJECTS:
        one = todo.pop()
        if id(one) in targets:
            return True
        if isinstance(one, ATOMS) or id(one) in seen:
            continue
        seen.add(id(one))
        kept.append(one)
        if isinstance(one, types.FunctionType):
            todo += _referred(one)
        elif isinstance(one, weakref.ref):
            todo.append(one())
        elif isinstance(one, type):
            todo += _of_local_class(one)
        else:
            todo += [part for _, part in _parts("", one)]
            todo += local_methods(one)
    return False


def kept_by(function: object, besides: Container[int] = ()) -> str | None:
    """The state that a function or a method of a built-in object keeps between calls, or None.

    Globals, which all environments share, do not count.

    Args:
      function: the function; anything else keeps nothing.
      besides: ids of objects that do not count.
    """
    if _is_global(function):
        return None
    if isinstance(function, functools.partial):
        parts = (function.func, *function.args, *function.keywords.values())
        return _first_kept(parts, besides)
    if isinstance(function, types.BuiltinFunctionType | types.MethodWrapperType):
        owner = function.__self__
        is_free = owner is None or isinstance(owner, (*ATOMS, type, tuple, frozenset))
        return None if is_free else f"a {type(owner).__name__}"
    if not isinstance(function, types.FunctionType):
        return None
    attributes = {name for name in vars(function) if name != "__wrapped__"}
    if attributes:
        return f"an attribute {min(attributes)!r} of it"
    enclosed = [*cells_of(function), *(function.__defaults__ or ())]
    enclosed += (function.__kwdefaults__ or {}).values()
    if not enclosed:
        return None
    if function.__code__.co_freevars and _writes(function.__code__):
        return "what it assigns to"
    return _first_kept(enclosed, besides)


def is_live(value: object) -> bool:
    """Whether an array, or a part of a model or of data, is a view of a simulation's memory."""
    kind = type(value)
    if kind.__module__ in _PARTS_OF_SIMULATIONS and kind.__name__ not in _WHOLE:
        return True
    while isinstance(value, np.ndarray):
        value = value.base
    return type(value).__name__ == "PyCapsule"


def local_methods(value: object) -> list[object]:
    """The functions of the classes of an object that a function defines, with their closures."""
    return [part for cls in type(value).__mro__ for part in _of_local_class(cls)]


def counts_in_closure(value: object) -> bool:
    """Whether the class of an object, which a function defines, assigns to enclosed variables."""
    functions = (one for one in local_methods(value) if isinstance(one, types.FunctionType))
    return any(one.__code__.co_freevars and _writes(one.__code__) for one in functions)


def _of_local_class(cls: type) -> list[object]:
    if "<locals>" not in cls.__qualname__:
        return []
    return [getattr(part, "__func__", getattr(part, "fget", part)) for part in vars(cls).values()]


def _first_kept(values: Iterable[object], besides: Container[int]) -> str | None:
    return next((kept for one in values if (kept := _kept_in(one, besides)) is not None), None)


def _kept_in(value: object, besides: Container[int]) -> str | None:
    """The part that can change of a value that a function encloses; None if nothing can."""
    if id(value) in besides or _is_global(value):
        return None
    if isinstance(value, types.MethodType):
        return _kept_in(value.__self__, besides)
    if isinstance(value, types.FunctionType | types.BuiltinFunctionType | functools.partial):
        return kept_by(value, besides)
    if isinstance(value, (*ATOMS, type, np.dtype, np.ufunc)):
        return None
    if is_live(value):
        return "an array of a simulation"
    if isinstance(value, np.ndarray) and value.dtype != object:
        return None  # a function that writes to it is found by its code
    if isinstance(value, tuple | frozenset):
        return _first_kept(value, besides)
    return f"a {type(value).__name__}"


def _is_global(value: object) -> bool:
    """Whether a value is a module's own function or class."""
    if not callable(value):
        return False
    module = sys.modules.get(getattr(value, "__module__", None) or "")
    return getattr(module, getattr(value, "__name__", ""), None) is value


def _writes(code: types.CodeType) -> bool:
    """Whether code assigns to enclosed variables, to elements or to attributes."""
    if any(one.opname in _WRITES for one in dis.get_instructions(code)):
        return True
    return any(_writes(one) for one in code.co_consts if isinstance(one, types.CodeType))


def _parts(path: str, value: object) -> Iterator[tuple[str, object]]:
    """The parts of an object, with paths."""
    if isinstance(value, functools.partial):
        yield from ((path, part) for part in (value.func, *value.args, *value.keywords.values()))
    elif isinstance(value, types.MethodType | types.BuiltinFunctionType | types.MethodWrapperType):
        yield path, value.__self__
    elif isinstance(value, np.ndarray):
        if value.dtype == object:
            yield from ((path, part) for part in value.ravel().tolist())
    elif isinstance(value, Mapping):
        yield from ((f"{path}[{key!r}]", part) for key, part in value.items())
        yield from ((path, key) for key in value)
    elif isinstance(value, list | tuple | set | frozenset | collections.deque):
        yield from ((path, part) for part in value)
    elif _is_physics(value):
        yield from ((_joined(path, name), part) for name, part in attributes_of(value).items())
    elif not type(value).__module__.startswith((_INTERNAL, "mujoco.")):
        for name, part in attributes_of(value).items():
            joined = _joined(path, name)
            if not joined.endswith(_NOT_COPIED):
                yield joined, part
        if type(value).__module__ in _C_MODULES:  # such as a map, which holds its function
            yield from ((path, part) for part in gc.get_referents(value))


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _referred(function: types.FunctionType) -> list[object]:
    """The objects that a function refers to, by closure, default, attribute or global name."""
    found: list[object] = [
        *(function.__defaults__ or ()),
        *(function.__kwdefaults__ or {}).values(),
        *cells_of(function),
        *vars(function).values(),
    ]
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        found += [
            function.__globals__[name] for name in code.co_names if name in function.__globals__
        ]
        codes += [const for const in code.co_consts if isinstance(const, types.CodeType)]
    return found


def cells_of(function: types.FunctionType) -> list[object]:
    """The values that a function encloses; empty cells are left out."""
    found = []
    for cell in function.__closure__ or ():
        try:
            found.append(cell.cell_contents)
        except ValueError:  # an empty cell
            continue
    return found
