"""Views of arrays and structs whose writes are refused with advice, or checked first.

    masses = ReadOnly.of(model.body_mass, "body_mass is shared by all rows: use randomize")
    masses[0] = 2.0     # ValueError with that message
    masses.copy()[0] = 2.0

    modes = Checked.of(model.cam_mode, check)
    modes[0] = 3        # calls check(modes as they would be), which raises or returns None

A view shares the memory of its array, so it always has the current values. Results of arithmetic
and copies are ordinary arrays. For NumPy every view is read-only, so any write that this module
does not intercept fails with NumPy's own message instead of passing unchecked.
"""

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Self, TypeGuard

import numpy as np
import numpy.typing as npt

__all__ = ["Checked", "ReadOnly", "ReadOnlyStruct"]

_COMMON = (
    "{} is shared by all rows and read-only: change it before creating the batch, or use randomize"
)
_TWO = "a NumPy function has more than one guarded array as `out`: write one field at a time"

_Change = Callable[[np.ndarray], object]

# NumPy's functions that write to their first argument, and its name.
_WRITERS: dict[object, str] = {
    np.copyto: "dst",
    np.fill_diagonal: "a",
    np.place: "arr",
    np.put: "a",
    np.put_along_axis: "arr",
    np.putmask: "a",
}


def _writer(name: str) -> Callable[..., None]:
    """One of NumPy's methods that write to an array, for `_Guarded`."""
    method = getattr(np.ndarray, name)

    @functools.wraps(method)
    def write(self: "_Guarded", *args: object, **kwargs: object) -> None:
        if self.flags.writeable:  # a copy
            method(self, *args, **kwargs)
        else:
            self._change(lambda array: method(array, *args, **kwargs))

    return write


class _Guarded(np.ndarray):
    """A view whose writes go through `_change`; a copy of it can be written directly."""

    def _change(self, change: _Change) -> None:
        """Applies `change`, which writes to its argument, to the viewed array; or raises."""
        raise NotImplementedError

    __setitem__ = _writer("__setitem__")
    fill = _writer("fill")
    partition = _writer("partition")
    put = _writer("put")
    setfield = _writer("setfield")
    sort = _writer("sort")

    def byteswap(self, inplace: bool = False) -> np.ndarray:
        """See `np.ndarray.byteswap`."""
        if not inplace:
            return np.ndarray.byteswap(self)
        _writer("byteswap")(self, inplace=True)
        return self

    @property
    def flat(self) -> Any:  # Any: NumPy's class of iterators cannot be subclassed
        """The elements in order, as `np.ndarray.flat`; writes are guarded too."""
        return np.ndarray.flat.__get__(self) if self.flags.writeable else _Flat(self)

    @flat.setter
    def flat(self, value: npt.ArrayLike) -> None:
        self.flat[...] = value

    def __array_ufunc__(
        self,
        ufunc: np.ufunc,
        method: str,
        *inputs: object,
        out: tuple[object, ...] = (None,),
        **kwargs: object,
    ) -> object:
        function, plain = getattr(ufunc, method), tuple([_plain(each) for each in inputs])
        # The usual case, which occurs in each step of a batch.
        if out[0] is None and len(out) == 1 and method != "at":
            return function(*plain, **kwargs)
        if method == "at":
            target = inputs[0]
            if not _is_view(target):
                return function(*plain, **kwargs)
            target._change(lambda array: function(array, *plain[1:], **kwargs))
            return None
        given = [_plain(each) for each in out]
        guarded = [(i, each) for i, each in enumerate(out) if _is_view(each)]
        if len(guarded) > 1:
            raise ValueError(_TWO)
        results: list[object] = []

        def write(array: np.ndarray | None = None) -> None:
            for i, _ in guarded:
                given[i] = array
            result = function(*plain, out=tuple(given), **kwargs)
            results.extend(result if len(out) > 1 else [result])

        if guarded:
            guarded[0][1]._change(write)
        else:
            write()
        pairs = zip(out, results, strict=True)
        written = [result if each is None else each for each, result in pairs]
        return tuple(written) if len(written) > 1 else written[0]

    def __array_function__(
        self,
        func: Callable[..., object],
        types: Iterable[type],
        args: Iterable[object],
        kwargs: Mapping[str, object],
    ) -> object:
        if "out" not in kwargs and func not in _WRITERS:  # the usual case
            return super().__array_function__(func, types, args, kwargs)
        name = _WRITERS.get(func, "out")
        given = tuple(args)
        target = given[0] if name != "out" and given else kwargs.get(name)
        if target is None or not _is_view(target):
            return super().__array_function__(func, types, args, kwargs)
        if name in kwargs:
            target._change(lambda array: func(*given, **{**kwargs, name: array}))
        else:
            target._change(lambda array: func(array, *given[1:], **kwargs))
        return None if func in _WRITERS else target

    def __reduce__(self) -> str | tuple[object, ...]:
        return self.view(np.ndarray).__reduce__()


class ReadOnly(_Guarded):
    """A read-only view of an array; see the module's docstring."""

    _advice = ""

    @classmethod
    def of(cls, array: np.ndarray, advice: str) -> Self:
        """A read-only view of `array`; writing to it raises ValueError with the text `advice`."""
        view = array.view(cls)
        view._advice = advice
        view.flags.writeable = False
        return view

    def __array_finalize__(self, source: object) -> None:
        self._advice = getattr(source, "_advice", "")

    def _change(self, change: _Change) -> None:
        raise ValueError(self._advice)


class Checked(_Guarded):
    """A view of an array whose writes are checked; see the module's docstring."""

    _whole: np.ndarray | None = None  # the viewed array, of which this may be a part
    _write: Callable[[np.ndarray], None] | None = None

    @classmethod
    def of(cls, array: np.ndarray, write: Callable[[np.ndarray], None]) -> Self:
        """A view of a contiguous array.

        Args:
          array: the array.
          write: called with new values for the whole array, of the same shape and type; it writes
            them to the array, or raises an error and changes nothing.
        """
        view = array.view(cls)
        view._whole, view._write = array, write
        view.flags.writeable = False
        return view

    def __array_finalize__(self, source: object) -> None:
        self._whole = getattr(source, "_whole", None)
        self._write = getattr(source, "_write", None)

    def _change(self, change: _Change) -> None:
        if not self.size:
            change(np.empty_like(self, subok=False))
            return
        if self._whole is None or self._write is None or not np.may_share_memory(self, self._whole):
            raise ValueError("assignment destination is read-only: write to a copy of it")
        values = self._whole.copy()
        change(_counterpart(self, self._whole, values))
        self._write(values)


class _Flat:
    """The elements of a guarded view in order; replaces NumPy's `flatiter`."""

    def __init__(self, array: _Guarded) -> None:
        self._array = array
        self._plain = array.view(np.ndarray).flat

    def __setitem__(self, key: slice | int, value: npt.ArrayLike) -> None:
        self._array._change(lambda array: array.flat.__setitem__(key, value))

    def __getitem__(self, key: slice | int) -> np.ndarray:
        return self._plain[key]

    def __iter__(self) -> Iterator[np.generic]:
        return iter(self._plain)

    def __next__(self) -> np.generic:
        return next(self._plain)

    def __len__(self) -> int:
        return len(self._plain)

    def __array__(
        self, dtype: type | np.dtype | None = None, copy: bool | None = None
    ) -> np.ndarray:
        return np.array(self._plain[:], dtype=dtype)

    def __getattr__(self, name: str) -> object:
        return getattr(self._plain, name)


def _is_view(value: object) -> TypeGuard[_Guarded]:
    return isinstance(value, _Guarded) and not value.flags.writeable


def _plain(value: object) -> object:
    return value.view(np.ndarray) if isinstance(value, _Guarded) else value


def _counterpart(part: np.ndarray, whole: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The view of `other` with the offset and strides that `part` has in `whole`.

    `whole` and `other` have the same layout.
    """
    start, first = (each.__array_interface__["data"][0] for each in (whole, part))
    return np.ndarray(part.shape, part.dtype, other.data, first - start, part.strides)


class ReadOnlyStruct:
    """A read-only view of a struct, such as `mujoco.MjOption`."""

    def __init__(
        self, struct: object, name: str, own: Mapping[str, np.ndarray] | None = None
    ) -> None:
        """Wraps a struct.

        Args:
          struct: the struct.
          name: its name, for messages.
          own: fields that differ per row, (num_envs, ...), which replace the struct's and may be
            writable.
        """
        vars(self).update(_struct=struct, _name=name, _own=own or {})

    def __getattr__(self, name: str) -> Any:  # attributes of the struct
        if name.startswith("_"):  # including those of an object not yet initialised
            raise AttributeError(name)
        if name in self._own:
            return self._own[name]
        value = getattr(self._struct, name)
        if isinstance(value, np.ndarray):
            return ReadOnly.of(value, _COMMON.format(f"{self._name}.{name}"))
        if callable(value) or isinstance(value, int | float | str | bytes):
            return value
        return ReadOnlyStruct(value, f"{self._name}.{name}")

    def __setattr__(self, name: str, value: object) -> None:
        if name in self._own:
            self._own[name][...] = value
            return
        raise ValueError(_COMMON.format(f"{self._name}.{name}"))
