"""`DeviceArray`: a tensor on which task code written for NumPy runs unchanged.

    heights = device_array(tensor)              # shares the tensor's memory
    np.minimum(heights, 1.0)[..., None] * 2     # a DeviceArray again, computed on the device
    plain(heights)                              # a torch.Tensor, for users

It has NumPy's protocols (`__array_ufunc__` and `__array_function__`) and the methods of arrays that
tasks use. Constants that are NumPy arrays are copied to the device once; NumPy numbers become
Python's, which keeps results in float32. Operations that would wait for the device raise TypeError
and name the replacement: `float`, `int`, `bool`, iteration, `np.asarray`.

The law of strict arrays (tests/laws) checks the same restrictions without a device.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from limberjack.gpu import functions
from limberjack.gpu.backend import torch

__all__ = ["DeviceArray", "constant", "device_array", "plain"]

_MOST_CONSTANTS = 4096  # cached arrays; a task has a few dozen

_Method = Callable[..., object]


def _numpys(function: _Method) -> _Method:
    """A method that is a function of NumPy, whose arguments or result a tensor's own has not."""
    return lambda self, *args, **kwargs: function(self, *args, **kwargs)


def _refused(what: str, instead: str) -> _Method:
    """A method that raises, as it would wait for the device."""

    def refuse(self: object, *args: object, **kwargs: object) -> NoReturn:
        raise TypeError(f"{what} would take an array out of the device's memory: {instead}")

    return refuse


def _unlike(name: str, instead: str) -> _Method:
    """A method that raises, as NumPy's changes the array, and a tensor's own does not."""
    return lambda self, *args, **kwargs: functions.refuse(f"the method {name}()", instead)


class DeviceArray(torch.Tensor):
    """See the module's docstring."""

    __array_priority__ = 1_000.0

    @classmethod
    def __torch_function__(
        cls,
        func: Callable[..., object],
        types: Iterable[type],
        args: Sequence[torch.Tensor] = (),  # or numbers, arrays and indices
        kwargs: Mapping[str, object] | None = None,
    ) -> object:
        kwargs = kwargs or {}
        if func in _SUBTRACTIONS or func in _PRODUCTS:
            args = _of_fitting_types(func, args)
        if func in _INDEXING and _is_backward(args[1]):
            args = _forwards(args)
        like = _first(args)
        if like is not None and any(isinstance(a, _FOREIGN) for a in (*args, *kwargs.values())):
            if func in _INDEXING:
                args = (args[0], _index(args[1], like), *(_value(arg, like) for arg in args[2:]))
            else:
                args = tuple(_value(arg, like) for arg in args)
                kwargs = {name: _value(value, like) for name, value in kwargs.items()}
        return super().__torch_function__(func, types, args, kwargs)

    def __array_ufunc__(
        self,
        ufunc: np.ufunc,
        method: str,
        *inputs: object,
        out: object = None,
        dtype: npt.DTypeLike | None = None,
        **kwargs: object,
    ) -> object:
        name = ufunc.__name__ if method == "__call__" else f"{ufunc.__name__}.{method}"
        compute = functions.of_ufunc(ufunc.__name__, method)
        if compute is None or kwargs.keys() - {"axis", "keepdims"}:
            functions.refuse(f"np.{name}")
        operands = [_operand(each, self) for each in inputs]
        if dtype is not None:
            kwargs["dtype"] = functions.dtype_of(dtype)
        return _written(compute(*operands, **kwargs), out, f"np.{name}")

    def __array_function__(
        self,
        function: Callable[..., object],
        types: Iterable[type],
        args: Sequence[object],
        kwargs: Mapping[str, object],
    ) -> object:
        name = functions.name_of(function)
        compute = functions.of_function(function)
        if compute is None:
            functions.refuse(name)
        if function is np.copyto:
            target, source = args[0], _operand(args[1], self)
            if "where" in kwargs:
                source = torch.where(
                    _operand(kwargs["where"], self), source, _operand(target, self)
                )
            return _written(source, target, name)
        given = [_converted(each, self) for each in args]
        named = {key: _converted(each, self) for key, each in kwargs.items() if key != "out"}
        try:
            result = compute(*given, **named)
        except TypeError as error:
            raise TypeError(f"{name} on a device: {error}") from error
        return _written(result, kwargs.get("out"), name)

    def as_index(self, positions: np.ndarray) -> "DeviceArray":
        """Positions as an index on this array's device; see `limberjack.utils.arrays.index_for`."""
        return constant(np.asarray(positions), self.device)

    # Methods of arrays whose names or arguments differ from a tensor's.

    def astype(self, dtype: npt.DTypeLike, copy: bool = True) -> torch.Tensor:
        """A copy of another number type; `float` is float32."""
        return self.to(functions.dtype_of(dtype), copy=copy)

    def copy(self) -> torch.Tensor:
        """A copy."""
        return self.clone()

    def transpose(self, *axes: int | Sequence[int]) -> torch.Tensor:
        """The array with its axes in another order."""
        return np.transpose(self, np.ravel(axes).tolist() or None)

    # A tensor's own `repeat` repeats the whole, and its `std` and `var` divide by n - 1.
    cumsum, dot, prod = _numpys(np.cumsum), _numpys(np.dot), _numpys(np.prod)
    max, mean, min = _numpys(np.max), _numpys(np.mean), _numpys(np.min)
    repeat, std, take, var = _numpys(np.repeat), _numpys(np.std), _numpys(np.take), _numpys(np.var)
    put = _unlike("put", "an assignment, as in x[..., 0] = y")
    resize = _unlike("resize", "np.reshape, which returns a new array")
    sort = _unlike("sort", "np.sort, which returns a new array")

    # Operations that would wait for the device.

    __array__ = _refused(
        "np.asarray()", "use the array itself, or np.stack and arrays.concat to join several"
    )
    __float__ = _refused("float()", "use the array itself: it holds one number for each row")
    __int__ = _refused("int()", "use the array itself, or .astype(int)")
    __index__ = _refused("use as an index of a list", "index an array instead")
    __bool__ = _refused(
        "bool(), as by `if`, `and`, `not`, `min` and `max`,",
        "write np.where for if, & for and, ~ for not, np.minimum and np.maximum for min and max",
    )
    __iter__ = _refused("iteration, as by `for` and unpacking,", "index the last axis: x[..., 0]")
    __contains__ = _refused("`in`", "compare, and use .any(axis=-1)")
    item = _refused("item()", "use the array itself")
    tolist = _refused("tolist()", "use the array itself")
    nonzero = _refused("nonzero()", "use the mask itself, in np.where or as an index")

    def __repr__(self, **kwargs: object) -> str:
        return f"DeviceArray(shape={tuple(self.shape)}, dtype={self.dtype}, device={self.device})"


def device_array(tensor: torch.Tensor) -> DeviceArray:
    """The tensor as a `DeviceArray` that shares its memory."""
    return tensor.as_subclass(DeviceArray)


def plain(value: torch.Tensor) -> torch.Tensor:
    """A quantity as a `torch.Tensor`; anything but a `DeviceArray` is returned as it is."""
    return value.as_subclass(torch.Tensor) if isinstance(value, DeviceArray) else value


def constant(values: np.ndarray, device: torch.device | str) -> DeviceArray:
    """A NumPy array as a tensor on the device: float32, int64 or bool; copied once."""
    values = np.ascontiguousarray(values)
    return _constant(values.tobytes(), values.dtype.str, values.shape, str(device))


@functools.lru_cache(maxsize=_MOST_CONSTANTS)
def _constant(content: bytes, dtype: str, shape: tuple[int, ...], device: str) -> DeviceArray:
    values = np.frombuffer(content, dtype).reshape(shape).copy()
    tensor = torch.from_numpy(values)
    return tensor.to(device, functions.dtype_of(values.dtype)).as_subclass(DeviceArray)


_FOREIGN = (np.ndarray, np.generic, list, tuple)
# Operators that NumPy has for masks and numbers together, and torch has not.
_SUBTRACTIONS = {
    *(torch.Tensor.sub, torch.Tensor.sub_, torch.Tensor.__rsub__, torch.sub, torch.subtract)
}
_PRODUCTS = {
    *(torch.Tensor.matmul, torch.matmul, torch.einsum, torch.tensordot, torch.linalg.vecdot)
}
_INDEXING = (torch.Tensor.__getitem__, torch.Tensor.__setitem__)


def _of_fitting_types(func: object, args: Sequence[torch.Tensor]) -> Sequence[torch.Tensor]:
    """The operands of an operator, with masks as numbers, and of one type for a product."""
    given = [arg for arg in args if isinstance(arg, torch.Tensor)]
    if func in _SUBTRACTIONS:
        is_mask = [isinstance(arg, torch.Tensor) and arg.dtype == torch.bool for arg in args]
        if all(is_mask):  # NumPy refuses this too
            return args
        pairs = zip(args, is_mask, strict=True)
        return tuple(arg.to(torch.int64) if masks else arg for arg, masks in pairs)
    if len({each.dtype for each in given}) < 2:
        return args
    kind = functools.reduce(torch.promote_types, (each.dtype for each in given))
    return tuple(arg.to(kind) if isinstance(arg, torch.Tensor) else arg for arg in args)


def _first(args: Iterable[object]) -> torch.Tensor | None:
    """The first tensor among arguments and in lists of them; None if no tensor is found."""
    for arg in args:
        found = _first(arg) if isinstance(arg, list | tuple) else arg
        if isinstance(found, torch.Tensor):
            return found
    return None


def _operand(given: object, like: torch.Tensor) -> torch.Tensor:
    """An operand of a ufunc as a tensor; a number as one without axes, which changes no dtype."""
    if isinstance(given, torch.Tensor):
        return given
    if isinstance(given, np.ndarray) and given.ndim:
        return constant(given, like.device)
    if isinstance(given, list | tuple):
        functions.refuse("a list of arrays as an operand", "np.stack")
    number = given.item() if isinstance(given, np.ndarray | np.generic) else given
    return torch.as_tensor(number, dtype=functions.dtype_of(type(number)))


def _value(given: object, like: torch.Tensor) -> object:
    """An argument of a tensor's operator or method: NumPy's arrays and numbers become torch's."""
    if isinstance(given, np.ndarray) and given.ndim:
        return constant(given, like.device)
    if isinstance(given, np.ndarray | np.generic):
        return given.item()
    return given


def _converted(given: object, like: torch.Tensor) -> object:
    """An argument of a NumPy function, with arrays converted inside of lists too."""
    if isinstance(given, list | tuple):
        return type(given)(_converted(each, like) for each in given)
    return _value(given, like)


def _index(key: object, like: torch.Tensor) -> object:
    """An index with the positions in it on the device."""
    if isinstance(key, tuple):
        return tuple(_index(each, like) for each in key)
    if isinstance(key, list) and not any(isinstance(each, slice) for each in key):
        return constant(np.array(key, None if key else int), like.device)
    return _value(key, like)


def _is_backward(key: object) -> bool:
    """Whether an index has a slice with a negative step, which torch has not."""
    return any(
        isinstance(each, slice) and isinstance(each.step, int | np.integer) and each.step < 0
        for each in (key if isinstance(key, tuple) else (key,))
    )


def _forwards(args: Sequence[torch.Tensor]) -> tuple[object, ...]:
    """An array and an index without slices that go backwards: those of its axes are reversed."""
    array, given, *values = args
    if values:
        functions.refuse("an assignment to a slice with a negative step", "x[...] = y[..., ::-1]")
    key: tuple[object, ...] = given if isinstance(given, tuple) else (given,)
    index, axis = list(key), 0
    for place, each in enumerate(key):
        if each is Ellipsis:
            axis = array.ndim - sum(map(_axes_of, key[place + 1 :]))
        elif isinstance(each, slice) and _is_backward(each):
            start, stop, step = each.indices(array.shape[axis])
            last = array.shape[axis] - 1
            index[place] = slice(last - start, last - stop, -step)
            array = array.flip(axis)
        if each is not Ellipsis:
            axis += _axes_of(each)
    return array, tuple(index)


def _axes_of(each: torch.Tensor) -> int:  # or a number, a slice or None
    """The number of axes that a part of an index selects from."""
    if each is None or isinstance(each, bool):
        return 0
    is_mask = getattr(each, "dtype", None) in (torch.bool, np.dtype(bool))
    return each.ndim if is_mask else 1


def _written(result: object, out: object, name: str) -> object:
    """The result, written into `out` if given."""
    target = out[0] if isinstance(out, tuple) else out
    if target is None:
        return result
    if not isinstance(target, DeviceArray):
        raise TypeError(
            f"{name} of an array on a device cannot write into a {type(target).__name__}: let it "
            "return a new array, as in x = x + y for x += y"
        )
    target.copy_(result)
    return target
