"""Values of JSON that anyone may have written, checked and converted as annotations say.

    entry_of(tuple[int, ...], [2, 3])       # (2, 3)
    entry_of(Card, json.loads(text))        # a dataclass, whose fields have annotations

Whole numbers are not negative and floating-point numbers are finite. An entry of a dataclass that
may be None may be left out; no other may be, and no further one may be there.
"""

import dataclasses
import functools
import sys
import types
import typing
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["entry_of", "shown"]

_LONGEST = 10_000  # characters of a text
_SHOWN = 80  # characters of a value in a message

_PLAIN: Mapping[object, tuple[Callable[[object], bool], str]] = {
    bool: (lambda value: isinstance(value, bool), "true or false"),
    dict: (lambda value: isinstance(value, dict), "an object of JSON"),
    float: (
        lambda value: (
            type(value) is not bool
            and isinstance(value, int | float)
            and abs(value) <= sys.float_info.max
        ),
        "a finite number, such as array.tolist() gives",
    ),
    int: (
        lambda value: type(value) is int and 0 <= value < 2**63,
        "a whole number from 0 on, such as array.tolist() gives",
    ),
    list: (lambda value: isinstance(value, list | tuple), "a list, such as array.tolist() gives"),
    object: (lambda value: True, "anything"),
    str: (
        lambda value: isinstance(value, str) and len(value) <= _LONGEST,
        f"a text of up to {_LONGEST} characters",
    ),
}


# Any: a value of the annotation.
def entry_of(kind: object, value: object, name: str | None = None) -> Any:
    """The value of JSON in the form of an annotation.

    Args:
      kind: a key of `_PLAIN`, a dataclass, or `X | None`, `Mapping[str, X]`, `tuple[X, ...]` or
        `tuple[X, Y]` of such.
      value: anything.
      name: of the value, for the message of an error; None for none.

    Raises:
      ValueError: it has another form.
    """
    try:
        return _read(kind, value)
    except ValueError as error:
        if name is None:
            raise
        raise ValueError(f"{name} is {shown(value)}; {error}") from None


def _read(kind: object, value: object) -> Any:  # Any: as above
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:
        return None if value is None else _read(parts[0], value)
    if origin is tuple:
        entries = _plain(list, value)
        kinds = parts[:1] * len(entries) if parts[1:] == (...,) else parts
        if len(entries) != len(kinds):
            raise ValueError(f"expected a list of {len(kinds)}")
        return tuple(map(_read, kinds, entries))
    if origin is Mapping:
        entries = _plain(dict, value)
        return {_read(str, name): _read(parts[1], one) for name, one in entries.items()}
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return _of_fields(kind, _plain(dict, value))
    return _plain(kind, value)


def shown(value: object) -> str:
    """A value from anyone, in at most a few words."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def _plain(kind: object, value: object) -> Any:  # Any: as above
    is_valid, expected = _PLAIN[kind]
    if not is_valid(value):
        raise ValueError(f"expected {expected}")
    return float(value) if kind is float and isinstance(value, int) else value


def _of_fields(kind: type, entries: Mapping[str, object]) -> object:
    kinds, optional = _fields(kind)
    other = sorted((entries.keys() | optional) ^ kinds.keys())
    if other:
        raise ValueError(f"entries {shown(other)} are missing or unknown")
    return kind(**{name: entry_of(kinds[name], one, name) for name, one in entries.items()})


@functools.cache
def _fields(kind: type) -> tuple[dict[str, object], set[str]]:
    """The annotations of a dataclass, and the names of entries that may be left out."""
    kinds = typing.get_type_hints(kind)
    return kinds, {name for name, one in kinds.items() if type(None) in typing.get_args(one)}
