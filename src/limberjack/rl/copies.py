"""Independent copies of environments, and a check that copies share no state.

    difference(env)       # "its class Half overrides step"; None for a plain `control.Environment`
    check_copies(env)     # raises TypeError if a copy would share state with the original
    twin = copied(env)    # continues as `env` does, bit for bit

A plain environment can be seeded; any other may keep anything anywhere, so its copies are made of
all its attributes. `copy.deepcopy` does not copy functions, nor what they refer to: a copy of an
environment whose `step` is `lambda a: old(a)` would step the original.
"""

import collections
import copy
import functools
import random
import types
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

import dm_env
import numpy as np

from limberjack.rl.memory import attributes_of

__all__ = ["check_copies", "control_of", "copied", "difference", "exact_copies"]

_MOST_OBJECTS = 100_000  # that are looked at; an environment with more holds data, not functions
_ATOMS = (str, bytes, int, float, complex, bool, type(None), type, types.ModuleType, range)
_INTERNAL = "limberjack.mujoco."  # objects without references to a user's
_STREAMS = (np.random.RandomState, np.random.Generator, np.random.BitGenerator, random.Random)
_ITERATORS = (types.GeneratorType, types.CoroutineType, types.AsyncGeneratorType)
_DERIVED = ("_seeded", "_draws")  # attributes of an environment with streams made from the task's

_Env = TypeVar("_Env")


def difference(env: object) -> str | None:
    """The first difference from a plain `control.Environment`, as a clause; None if there is none.

    Differences are overridden or replaced methods and additional attributes, but not additional
    methods.
    """
    from limberjack.rl.control import ATTRIBUTES, Environment

    cls = type(env)
    if not isinstance(env, Environment):
        return f"it is a {cls.__name__}, not a control.Environment"
    overridden = _overridden(cls, Environment)
    if overridden is not None:
        return overridden
    for name, value in vars(env).items():
        if name in ATTRIBUTES:
            continue
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
    from limberjack.rl.control import Environment

    todo, seen = [env], set()
    while todo:
        one = todo.pop(0)
        if id(one) in seen:
            continue
        seen.add(id(one))
        inside = getattr(one, "__dict__", {})
        if isinstance(one, Environment) and "_task" in inside:
            return one
        todo += [value for value in inside.values() if isinstance(value, dm_env.Environment)]
    return None


def copied(env: _Env) -> _Env:
    """A copy that continues bit for bit as the environment would."""
    memo: dict[int, object] = {}
    exact_copies(env, memo)
    return copy.deepcopy(env, memo)


def exact_copies(env: object, memo: dict[int, object]) -> None:
    """Adds exact copies of the physics within an environment to a memo of `copy.deepcopy`.

    A copied physics alone recomputes its quantities, as in dm_control, which changes the solver's
    warm start.
    """
    for _, value in _reachable(env):
        kind: Any = type(value)  # a Physics, whose module imports this one
        if hasattr(kind, "become") and "_simulation" in vars(value) and id(value) not in memo:
            memo[id(value)] = twin = kind.__new__(kind)
            twin.become(copy.deepcopy(value.__getstate__(), memo))


def check_copies(env: object) -> None:
    """Raises TypeError if copies of an environment would not be independent.

    The message names the attribute, and asks for a function that makes the environment.
    """
    inner = control_of(env)
    task, physics = getattr(inner, "_task", None), getattr(inner, "_physics", None)
    own = [env, inner, task, physics, *getattr(physics, "__dict__", {}).values()]
    targets = {id(one) for one in own if one is not None and not isinstance(one, _ATOMS)}
    stream = getattr(task, "_random", getattr(task, "random", None))
    for path, value in _reachable(env):
        if isinstance(value, types.FunctionType | functools.partial):
            if _reaches(value, targets):
                raise _refused(env, path, "is a function that uses the environment itself")
        elif isinstance(value, _STREAMS) and value is not stream:
            bit_generator = getattr(stream, "_bit_generator", None)
            if value is not bit_generator:
                raise _refused(env, path, "is a random stream other than the task's")
        elif isinstance(value, _ITERATORS):
            raise _refused(env, path, f"is a {type(value).__name__}, which cannot be copied")
    try:
        copied(env)
    except Exception as error:  # of any class: it is the user's object
        name = _cannot_be_copied(env)
        raise _refused(env, name, f"cannot be copied ({type(error).__name__}: {error})") from error


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


def _reachable(root: object) -> Iterator[tuple[str, object]]:
    """Objects that an environment holds, each once, with the attribute that leads to it.

    Functions are included, but not what they refer to.
    """
    seen: set[int] = set()
    todo: collections.deque[tuple[str, object]] = collections.deque([("", root)])
    while todo and len(seen) < _MOST_OBJECTS:
        path, value = todo.popleft()
        if isinstance(value, _ATOMS) or id(value) in seen:
            continue
        seen.add(id(value))
        yield path, value
        if not isinstance(value, types.FunctionType):
            todo.extend(_parts(path, value))


def _parts(path: str, value: object) -> Iterator[tuple[str, object]]:
    """The parts of an object, with paths."""
    if isinstance(value, functools.partial):
        yield from ((path, part) for part in (value.func, *value.args, *value.keywords.values()))
    elif isinstance(value, types.MethodType):
        yield path, value.__self__
    elif isinstance(value, np.ndarray):
        if value.dtype == object:
            yield from ((path, part) for part in value.ravel().tolist())
    elif isinstance(value, Mapping):
        yield from ((f"{path}[{key!r}]", part) for key, part in value.items())
        yield from ((path, key) for key in value)
    elif isinstance(value, list | tuple | set | frozenset | collections.deque):
        yield from ((path, part) for part in value)
    elif hasattr(value, "_attributes") and "_simulation" in getattr(value, "__dict__", {}):
        attributes: Mapping[str, object] = value._attributes()  # pyright: ignore
        yield from ((_joined(path, name), part) for name, part in attributes.items())
    elif not type(value).__module__.startswith((_INTERNAL, "mujoco.")):
        for name, part in attributes_of(value).items():
            if name not in _DERIVED:
                yield _joined(path, name), part


def _joined(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _reaches(function: object, targets: set[int]) -> bool:
    """Whether a function refers to one of the objects: by closure, default, global or attribute."""
    seen: set[int] = set()
    todo = [function]
    while todo and len(seen) < _MOST_OBJECTS:
        value = todo.pop()
        if id(value) in targets:
            return True
        if isinstance(value, _ATOMS) or id(value) in seen:
            continue
        seen.add(id(value))
        if isinstance(value, types.FunctionType):
            todo += _referred(value)
        else:
            todo += [part for _, part in _parts("", value)]
    return False


def _referred(function: types.FunctionType) -> list[object]:
    """The objects that a function refers to, by closure, default, attribute or global name."""
    found: list[object] = [
        *(function.__defaults__ or ()),
        *(function.__kwdefaults__ or {}).values(),
    ]
    for cell in function.__closure__ or ():
        try:
            found.append(cell.cell_contents)
        except ValueError:  # an empty cell
            continue
    found += vars(function).values()
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        found += [
            function.__globals__[name] for name in code.co_names if name in function.__globals__
        ]
        codes += [const for const in code.co_consts if isinstance(const, types.CodeType)]
    return found
