"""`StrictArray`: an array with the restrictions of an array on a GPU, to test task code.

    heights = StrictArray(np.arange(3.0))
    np.minimum(heights, 1.0)[..., None] * 2      # a StrictArray again, with NumPy's bits
    float(heights[0])                            # TypeError: float() of a strict array

Task code that runs on it uses only operators, indexing and NumPy's functions, which work on any
kind of array through the protocols `__array_ufunc__` and `__array_function__`. Any operation that
reads the values, which would synchronise with a GPU, raises TypeError and is named: `np.asarray`,
`float`, `int`, `bool`, iteration, and `out=` into a NumPy array.

It copies where NumPy copies, and returns views where NumPy does. `values_of` is for tests.
"""

import operator
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

import numpy as np

__all__ = ["StrictArray", "values_of"]

# Any in this module: whatever NumPy's functions take and return.
_METHODS = (
    *("reshape", "copy", "astype", "ravel", "dot", "sum", "mean", "max", "min", "any", "all"),
    *("prod", "cumsum", "clip", "argmax", "argmin", "squeeze", "transpose"),
)
# Functions that write into their first argument.
_WRITE_INTO_THE_FIRST = (np.copyto, np.put, np.place, np.putmask, np.fill_diagonal)


class StrictArray(np.lib.mixins.NDArrayOperatorsMixin):
    """See the module's docstring."""

    __array_priority__ = 1_000.0

    def __init__(self, values: np.ndarray) -> None:
        self._values = np.asanyarray(values)

    @property
    def shape(self) -> tuple[int, ...]:
        return self._values.shape

    @property
    def ndim(self) -> int:
        return self._values.ndim

    @property
    def dtype(self) -> np.dtype:
        return self._values.dtype

    @property
    def size(self) -> int:
        return self._values.size

    @property
    def T(self) -> "StrictArray":  # noqa: N802
        return StrictArray(self._values.T)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return f"StrictArray(shape={self.shape}, dtype={self.dtype})"

    def __getitem__(self, key: Any) -> "StrictArray":
        return StrictArray(self._values[_key(key)])

    def __setitem__(self, key: Any, value: Any) -> None:
        self._values[_key(key)] = _open(value)

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name not in _METHODS:
            raise AttributeError(f"a strict array has no {name!r}")

        def method(*args: Any, **kwargs: Any) -> Any:
            _check_out(name, kwargs)
            return _strict(getattr(self._values, name)(*_open(args), **_open(kwargs)))

        return method

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        name = ufunc.__name__ if method == "__call__" else f"{ufunc.__name__}.{method}"
        _check_out(f"np.{name}", kwargs)
        _check_lists(f"np.{name}", inputs)
        return _strict(getattr(ufunc, method)(*_open(inputs), **_open(kwargs)))

    def __array_function__(
        self, function: Callable[..., Any], types: Any, args: Any, kwargs: dict[str, Any]
    ) -> Any:
        name = f"np.{function.__name__}"
        written = {"out": args[0]} if function in _WRITE_INTO_THE_FIRST and args else kwargs
        _check_out(name, written)
        return _strict(function(*_open(args), **_open(kwargs)))

    # Operations that read the values.

    def __array__(self, *args: Any, **kwargs: Any) -> NoReturn:
        _refuse("np.asarray()")

    def __float__(self) -> NoReturn:
        _refuse("float()")

    def __int__(self) -> NoReturn:
        _refuse("int()")

    def __index__(self) -> NoReturn:
        _refuse("use as an index of a list, or in range()")

    def __complex__(self) -> NoReturn:
        _refuse("complex()")

    def __bool__(self) -> NoReturn:
        _refuse("bool(), as by `if`, `and`, `not`, `min` and `max`,")

    def __iter__(self) -> Iterator[Any]:
        _refuse("iteration, as by `for` and unpacking,")

    def __contains__(self, item: object) -> NoReturn:
        _refuse("`in`")

    def item(self) -> NoReturn:
        """Refuses."""
        _refuse("item()")

    def tolist(self) -> NoReturn:
        """Refuses."""
        _refuse("tolist()")


def values_of(array: Any) -> Any:
    """The values of a strict array, for comparisons in tests; other objects unchanged."""
    return array._values if isinstance(array, StrictArray) else array


def _refuse(what: str) -> NoReturn:
    raise TypeError(f"{what} of a strict array takes its values out of the device's memory")


def _check_out(name: str, kwargs: dict[str, Any]) -> None:
    """Raises TypeError if results would be written into a NumPy array."""
    out = kwargs.get("out")
    for array in out if isinstance(out, tuple) else (out,):
        if array is not None and not isinstance(array, StrictArray):
            raise TypeError(
                f"{name} of a strict array cannot write into out=, a {type(array).__name__}"
            )


def _check_lists(name: str, inputs: tuple[Any, ...]) -> None:
    """Raises TypeError if an argument is a list that contains strict arrays."""
    for given in inputs:
        if isinstance(given, list | tuple) and any(isinstance(each, StrictArray) for each in given):
            raise TypeError(f"{name} is given a list of strict arrays; join them with np.stack")


def _key(key: Any) -> Any:
    """A NumPy index for one that may contain strict arrays."""
    if isinstance(key, tuple):
        return tuple(map(_key, key))
    if isinstance(key, StrictArray) and key.ndim == 0 and key.dtype != bool:
        return operator.index(key._values.item())
    return _open(key)


def _open(given: Any) -> Any:
    """Arguments, with strict arrays replaced by their values."""
    if isinstance(given, StrictArray):
        return given._values
    if isinstance(given, tuple | list):
        return type(given)(map(_open, given))
    if isinstance(given, dict):
        return {name: _open(value) for name, value in given.items()}
    return given


def _strict(result: Any) -> Any:
    """Results, with NumPy arrays and numbers replaced by strict arrays."""
    if isinstance(result, np.ndarray | np.generic):
        return StrictArray(np.asarray(result))
    if isinstance(result, tuple | list):
        return type(result)(map(_strict, result))
    return result
