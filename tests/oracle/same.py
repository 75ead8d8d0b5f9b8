"""`assert_same`: equal Python types and equal bits, with a message about the first difference."""

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

__all__ = ["assert_same", "assert_same_outcome", "assert_same_pair", "difference", "fields"]

# Not compared: memory addresses, and dm_control's own helper attributes.
_NOT_CONTENT = {"_address", "ptr", "range_", "type_"}


def assert_same(ours: Any, theirs: Any, where: str) -> None:
    """Fails unless both are of one Python type and hold the same bits, at every depth.

    Mappings have the same keys in the same order; arrays the same dtype and shape. NaN equals the
    same NaN, and 0.0 is not -0.0.
    """
    # Building messages in advance would take half the time of the whole-episode tests.
    if not _is_same(ours, theirs):
        raise AssertionError(difference(ours, theirs, where))


def _is_same(ours: Any, theirs: Any) -> bool:
    if type(ours) is not type(theirs):
        return False
    if isinstance(theirs, np.ndarray | np.generic):
        return (
            ours.dtype == theirs.dtype
            and ours.shape == theirs.shape
            and ours.tobytes() == theirs.tobytes()
        )
    if isinstance(theirs, Mapping):
        return list(ours) == list(theirs) and all(_is_same(ours[key], theirs[key]) for key in ours)
    if isinstance(theirs, tuple | list):
        return len(ours) == len(theirs) and all(map(_is_same, ours, theirs))
    if isinstance(theirs, float):
        return struct.pack("d", ours) == struct.pack("d", theirs)
    return bool(ours == theirs)


def difference(ours: Any, theirs: Any, where: str) -> str:
    """Describes the first difference between two values that are not the same."""
    if type(ours) is not type(theirs):
        kinds = f"{type(ours).__name__} {ours!r}, dm_control has {type(theirs).__name__} {theirs!r}"
        return f"{where}: {kinds}"
    if isinstance(theirs, Mapping):
        if list(ours) != list(theirs):
            return f"{where}: keys {list(ours)}, dm_control has {list(theirs)}"
        pairs = [(f"{where}[{key!r}]", ours[key], theirs[key]) for key in theirs]
    elif isinstance(theirs, tuple | list):
        if len(ours) != len(theirs):
            return f"{where}: length {len(ours)}, dm_control has {len(theirs)}"
        names = getattr(theirs, "_fields", range(len(theirs)))
        pairs = [
            (f"{where}.{name}", *both) for name, *both in zip(names, ours, theirs, strict=True)
        ]
    elif isinstance(theirs, np.ndarray):
        return f"{where}: {_first_difference(ours, theirs)}"
    else:
        return f"{where}: {ours!r}, dm_control has {theirs!r}"
    return next(
        difference(mine, yours, name) for name, mine, yours in pairs if not _is_same(mine, yours)
    )


def _first_difference(ours: np.ndarray, theirs: np.ndarray) -> str:
    """The first difference of two arrays in dtype, shape or bits, and the number of differences."""
    if ours.dtype != theirs.dtype or ours.shape != theirs.shape:
        return f"{ours.dtype}{ours.shape}, dm_control has {theirs.dtype}{theirs.shape}"
    places = [
        place
        for place in np.ndindex(theirs.shape)
        if ours[place].tobytes() != theirs[place].tobytes()
    ]
    return (
        f"at {list(places[0])} {ours[places[0]]!r}, dm_control has {theirs[places[0]]!r}; "
        f"{len(places)} of {theirs.size} elements differ"
    )


def assert_same_pair(pair: Iterable[Any], where: str) -> None:
    """`assert_same` of the two: ours, then dm_control's."""
    ours, theirs = pair
    assert_same(ours, theirs, where)


def fields(struct: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Name and value of every array, number and text in a MuJoCo struct, including nested structs.

    Fields are found by `dir`, so those of newer MuJoCo versions are compared too.
    """
    for name in dir(struct):
        if name.startswith("__") or name in _NOT_CONTENT:
            continue
        value = getattr(struct, name)
        if isinstance(value, np.ndarray | bool | int | float | bytes):
            yield prefix + name, value
        elif type(value).__module__.startswith("mujoco") and not callable(value):
            yield from fields(value, f"{prefix}{name}.")


def assert_same_outcome(calls: Iterable[Callable[[], Any]], where: str) -> Exception | None:
    """Fails unless our call gives dm_control's result or raises an error of the same type.

    Returns the error that our call raised. Messages may differ: ours are more detailed.
    """
    (our_value, our_error), (their_value, their_error) = map(_outcome, calls)
    if their_error is None:
        assert our_error is None, f"{where}: {our_error!r}, dm_control returns {their_value!r}"
        assert_same(our_value, their_value, where)
        return None
    assert our_error is not None, f"{where}: {our_value!r}, dm_control raises {their_error!r}"
    assert _is_kind_of(our_error, their_error), (
        f"{where}: {our_error!r}, dm_control raises {their_error!r}"
    )
    return our_error


def _is_kind_of(ours: Exception, theirs: Exception) -> bool:
    """Whether code that catches dm_control's error also catches ours."""
    # For a name on an axis without names, dm_control leaves the error to NumPy.
    if isinstance(theirs, IndexError) and "indices" in str(theirs):
        return isinstance(ours, LookupError)
    # PhysicsError and wrapper.Error are classes of the same name in each package.
    return type(theirs).__name__ in [kind.__name__ for kind in type(ours).__mro__]


def _outcome(call: Callable[[], Any]) -> tuple[Any, Exception | None]:
    try:
        return call(), None
    except Exception as error:
        return None, error
