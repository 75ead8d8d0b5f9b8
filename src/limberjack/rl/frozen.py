"""`Frozen`: values that are compared at a later time, or with those of another environment.

    before = Frozen()(task.__dict__)
    ...
    changed = Frozen()(task.__dict__) != before

    # Of two environments that were made alike; `own` holds the ids of the parts of each.
    same = Alike(type, own)(vars(one.task)) == Alike(type, own)(vars(other.task))

Parts are copied, to any depth: elements, attributes, closures, states of random streams.
"""

import array
import collections
import enum
import functools
import itertools
import types
import warnings
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from limberjack.rl.references import STREAMS, attributes_of, cells_of
from limberjack.rl.shared_streams import state_of

__all__ = ["Alike", "Frozen"]

_MOST_PARTS = 20_000  # of the values of one task; an object with more is not compared further
_ATOMS = (str, bytes, int, complex, bool, type(None), range)
# Modules of iterators that keep their place in memory of C.
_OF_ITERATORS = ("builtins", "itertools", "collections")


class Frozen:
    """Makes values comparable at a later time, by copying their parts."""

    def __init__(self, opaque: set[int] | None = None) -> None:
        """Takes the ids of objects that are compared by identity."""
        self._opaque = opaque or set()
        self._seen: dict[int, int] = {}
        # Keeps what was seen alive, so that no id is used twice.
        self._kept: list[object] = []

    def __call__(self, value: object) -> object:
        """The parts of a value, to be compared."""
        if isinstance(value, _ATOMS) and not isinstance(value, enum.Enum):
            return type(value), value
        if isinstance(value, float):
            return value.hex()
        if isinstance(value, np.generic):
            return value.dtype.str, value.tobytes()
        if id(value) in self._opaque or isinstance(value, type | types.ModuleType):
            return self._identity(value)
        if id(value) in self._seen or len(self._seen) > _MOST_PARTS:
            return "seen", self._seen.get(id(value))
        self._seen[id(value)] = len(self._seen)
        self._kept.append(value)
        return self._parts(value)

    def _identity(self, value: object) -> object:
        """A value that tells an object from others, besides its parts."""
        return id(value)

    def _stream(self, stream: object) -> object:
        return state_of(stream)

    def _parts(self, value: object) -> object:
        if isinstance(value, np.ndarray):
            if value.dtype == object:
                return value.shape, [self(part) for part in value.ravel().tolist()]
            return value.dtype.str, value.shape, value.tobytes()
        if isinstance(value, bytearray | memoryview | array.array):
            return type(value), bytes(value)
        if isinstance(value, STREAMS):
            return self._stream(value)
        if isinstance(value, enum.Enum):
            return type(value).__qualname__, value.name
        if isinstance(value, Mapping):
            return type(value), [(self(key), self(part)) for key, part in value.items()]
        if isinstance(value, list | tuple | collections.deque):
            return type(value), [self(part) for part in value]
        if isinstance(value, set | frozenset):
            return type(value), sorted(repr(self(part)) for part in value)
        if isinstance(value, types.FunctionType):
            defaults = value.__defaults__, value.__kwdefaults__
            parts = cells_of(value), vars(value), defaults
            return self._code(value), [self(part) for part in parts]
        if isinstance(value, types.MethodType):
            return self(value.__func__), self(value.__self__)
        if isinstance(value, functools.partial):
            return self((value.func, value.args, value.keywords))
        if isinstance(value, types.GeneratorType):
            frame = value.gi_frame
            return None if frame is None else (frame.f_lasti, self(dict(frame.f_locals)))
        if isinstance(value, Iterator) and type(value).__module__ in _OF_ITERATORS:
            return type(value), self._place(value)
        attributes = attributes_of(value)
        return self._identity(value), [(name, self(part)) for name, part in attributes.items()]

    def _code(self, function: types.FunctionType) -> object:
        return id(function.__code__)

    def _place(self, iterator: "Iterator[object]") -> object:
        """The place at which an iterator is; never the same if it does not say."""
        if isinstance(iterator, itertools.count | itertools.repeat):
            return repr(iterator)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # Python gives up pickles of itertools
                _, given, *state = iterator.__reduce__()  # pyright: ignore[reportAssignmentType]
        except (TypeError, ValueError):
            return object()
        return self(given), [self(part) for part in state]


class Alike(Frozen):
    """Makes the values of two environments comparable that were made in the same way.

    Objects are compared by their classes and parts. The state of a stream is left out: it is that
    of a seed.
    """

    def __init__(self, kind: Callable[[object], object], own: set[int]) -> None:
        """Takes what stands for the class of an object, and the ids of parts of its environment."""
        super().__init__(own)
        self._kind = kind

    def _identity(self, value: object) -> object:
        if id(value) in self._opaque:
            return "its own"
        return value if isinstance(value, type | types.ModuleType) else self._kind(value)

    def _stream(self, stream: object) -> object:
        return self._kind(stream)

    def _code(self, function: types.FunctionType) -> object:
        return function.__code__
