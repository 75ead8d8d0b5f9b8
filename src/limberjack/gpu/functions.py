"""NumPy's functions by their counterparts for tensors.

    of_ufunc("minimum", "__call__")         # torch.minimum
    of_function(np.concatenate)             # torch.cat, with NumPy's arguments

A function without a counterpart is refused by name; see `refuse`.
"""

from collections.abc import Callable, Sequence
from typing import NoReturn

import numpy as np
import numpy.typing as npt

from limberjack.gpu.backend import torch
from limberjack.utils.suggest import did_you_mean

__all__ = ["Axis", "dtype_of", "name_of", "of_function", "of_ufunc", "refuse"]

_Function = Callable[..., object]
Axis = int | tuple[int, ...] | None
_Type = npt.DTypeLike | torch.dtype
_Number = torch.Tensor | float

# Universal functions that have another name in torch, or a namesake that differs.
_UFUNCS: dict[str, _Function] = {
    "cbrt": lambda x: torch.sign(x) * torch.pow(torch.abs(x), 1 / 3),
    "conjugate": torch.conj,
    "degrees": torch.rad2deg,
    "equal": torch.eq,
    "fabs": torch.abs,
    "float_power": lambda x, y: torch.pow(_as_float(x), y),  # torch's own is in float64
    "invert": torch.bitwise_not,
    "left_shift": torch.bitwise_left_shift,
    "modf": lambda x: (torch.frac(x), torch.trunc(x)),
    "power": torch.pow,
    "radians": torch.deg2rad,
    "right_shift": torch.bitwise_right_shift,
    "rint": torch.round,
    "vecdot": torch.linalg.vecdot,
}
_REDUCTIONS: dict[str, str] = {
    "add": "sum",
    "logical_and": "all",
    "logical_or": "any",
    "maximum": "amax",
    "minimum": "amin",
    "multiply": "prod",
}


def of_ufunc(name: str, method: str) -> _Function | None:
    """The counterpart of a universal function, called with tensors; None if it has none."""
    if method == "reduce" and name in _REDUCTIONS:
        return _reduction(_REDUCTIONS[name], default_axis=0)
    if method != "__call__":
        return None
    return _UFUNCS.get(name) or getattr(torch, name, None)


def of_function(function: _Function) -> _Function | None:
    """The counterpart of another NumPy function, with NumPy's arguments; None if it has none."""
    return _FUNCTIONS.get(function)


def name_of(function: _Function) -> str:
    """The name to write for a function, such as 'np.linalg.norm'."""
    module = (getattr(function, "__module__", None) or "numpy").replace("numpy", "np", 1)
    return f"{module}.{function.__name__}"


def refuse(name: str, instead: str = "") -> NoReturn:
    """Raises TypeError for a function without a counterpart, with the nearest ones."""
    known = sorted({name_of(function) for function in _FUNCTIONS})
    hint = f" Use {instead}." if instead else did_you_mean(name, known)
    raise TypeError(
        f"{name} is not available for arrays on a device.{hint} Available are NumPy's operators, "
        f"universal functions and {', '.join(known)}; see docs/gpu.md"
    )


def dtype_of(dtype: _Type) -> torch.dtype:
    """The number type on a device: float32 for every float, int64 for integers, bool."""
    if isinstance(dtype, torch.dtype):
        return dtype
    kind = np.dtype(dtype).kind
    if kind not in "fiub":
        raise TypeError(f"arrays on a device hold numbers; got dtype {dtype!r}")
    return {"f": torch.float32, "b": torch.bool}.get(kind, torch.int64)


def _reduction(name: str, default_axis: int | None = None) -> _Function:
    reduce = _product if name == "prod" else getattr(torch, name)

    def compute(
        x: torch.Tensor,
        axis: Axis = default_axis,
        dtype: _Type | None = None,
        keepdims: bool = False,
    ) -> torch.Tensor:
        if name == "mean":
            x = _as_float(x)
        result = reduce(x, _axes(x, axis), keepdim=keepdims)
        return result if dtype is None else result.to(dtype_of(dtype))

    return compute


def _product(x: torch.Tensor, axes: int | tuple[int, ...], keepdim: bool) -> torch.Tensor:
    for axis in _sorted(axes, x.ndim)[::-1]:  # torch multiplies along one axis only
        x = torch.prod(x, axis, keepdim=keepdim)
    return x


def _sorted(axes: int | tuple[int, ...], ndim: int) -> list[int]:
    """Axes of an array of `ndim` axes, counted from the first one."""
    return sorted(axis % ndim for axis in (axes if isinstance(axes, tuple) else (axes,)))


def _axes(x: torch.Tensor, axis: Axis) -> int | tuple[int, ...]:
    return tuple(range(x.ndim)) if axis is None else axis


def _moment(name: str) -> _Function:
    reduce = getattr(torch, name)

    def compute(
        x: torch.Tensor, axis: Axis = None, ddof: int = 0, keepdims: bool = False
    ) -> torch.Tensor:
        return reduce(_as_float(x), _axes(x, axis), correction=ddof, keepdim=keepdims)

    return compute


def _as_float(x: torch.Tensor) -> torch.Tensor:
    """The numbers as floats, of which torch takes means: the mean of a mask is a fraction."""
    return x if x.is_floating_point() else x.to(torch.float32)


def _arg(name: str) -> _Function:
    find = getattr(torch, name)
    return lambda x, axis=None, keepdims=False: find(x, axis, keepdim=keepdims)


def _norm(
    x: torch.Tensor, ord: float | str | None = None, axis: Axis = None, keepdims: bool = False
) -> torch.Tensor:
    x = _as_float(x)
    if axis is None and ord is None:
        return torch.linalg.vector_norm(x, keepdim=keepdims)
    return torch.linalg.norm(x, ord, axis, keepdims)


def _like(value: float) -> _Function:
    def make(x: torch.Tensor, dtype: _Type | None = None, **kwargs: object) -> torch.Tensor:
        kind = x.dtype if dtype is None else dtype_of(dtype)
        return torch.full_like(x, value, dtype=kind)

    return make


def _full_like(x: torch.Tensor, fill_value: _Number, dtype: _Type | None = None) -> torch.Tensor:
    filled = torch.empty_like(x, dtype=x.dtype if dtype is None else dtype_of(dtype))
    filled[...] = fill_value
    return filled


def _clip(
    x: torch.Tensor,
    a_min: _Number | None = None,
    a_max: _Number | None = None,
    **kwargs: _Number | None,
) -> torch.Tensor:
    low, high = kwargs.get("min", a_min), kwargs.get("max", a_max)
    x = x if low is None else torch.maximum(x, _number(low))
    return x if high is None else torch.minimum(x, _number(high))


def _where(condition: torch.Tensor, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
    # Each may also be a number.
    if not isinstance(condition, torch.Tensor):
        like = x if isinstance(x, torch.Tensor) else y
        condition = torch.full((), condition, dtype=torch.bool, device=like.device)
    if condition.dtype != torch.bool:
        condition = condition != 0
    return torch.where(condition, x, y)  # numbers stay numbers: copying them would wait


def _number(x: _Number) -> torch.Tensor:
    """A number as a tensor without axes of the device's number type."""
    return x if isinstance(x, torch.Tensor) else torch.as_tensor(x, dtype=dtype_of(type(x)))


def _dot(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    if not getattr(a, "ndim", 0) or not getattr(b, "ndim", 0):  # a number, perhaps Python's
        return a * b
    return torch.matmul(a, b) if b.ndim <= 2 else torch.tensordot(a, b, ([-1], [-2]))


def _concatenate(arrays: Sequence[torch.Tensor], axis: int | None = 0) -> torch.Tensor:
    if axis is None:
        return torch.cat([torch.ravel(each) for each in arrays])
    return torch.cat(tuple(arrays), axis)


def _cumsum(x: torch.Tensor, axis: int | None = None) -> torch.Tensor:
    return torch.cumsum(x.reshape(-1), 0) if axis is None else torch.cumsum(x, axis)


def _expand_dims(x: torch.Tensor, axis: int | tuple[int, ...]) -> torch.Tensor:
    count = len(axis) if isinstance(axis, tuple) else 1
    for each in _sorted(axis, x.ndim + count):
        x = torch.unsqueeze(x, each)
    return x


def _nan_to_num(
    x: torch.Tensor,
    copy: bool = True,
    nan: float = 0.0,
    posinf: float | None = None,
    neginf: float | None = None,
) -> torch.Tensor:
    result = torch.nan_to_num(x, nan, posinf, neginf)
    return result if copy else x.copy_(result)


def _take(x: torch.Tensor, indices: object, axis: int | None = None) -> torch.Tensor:
    if axis is None:
        x, axis = x.reshape(-1), 0
    return x[(slice(None),) * (axis % x.ndim) + (indices,)]


# Functions that are not universal, with NumPy's arguments.
_FUNCTIONS: dict[_Function, _Function] = {
    np.all: _reduction("all"),
    np.amax: _reduction("amax"),
    np.amin: _reduction("amin"),
    np.any: _reduction("any"),
    np.argmax: _arg("argmax"),
    np.argmin: _arg("argmin"),
    np.atleast_1d: torch.atleast_1d,
    np.broadcast_to: lambda array, shape: torch.broadcast_to(array, shape),
    np.clip: _clip,
    np.concatenate: _concatenate,
    np.copy: lambda a: a.clone(),
    np.copyto: lambda dst, src: dst.copy_(src),
    np.cross: lambda a, b, axis=-1: torch.linalg.cross(*torch.broadcast_tensors(a, b), dim=axis),
    np.cumsum: _cumsum,
    np.diff: lambda a, n=1, axis=-1: torch.diff(a, n, axis),
    np.dot: _dot,
    np.einsum: lambda text, *arrays: torch.einsum(text, *arrays),
    np.empty_like: _like(0),
    np.expand_dims: _expand_dims,
    np.flip: lambda x, axis=None: torch.flip(x, _sorted(_axes(x, axis), x.ndim)),
    np.full_like: _full_like,
    np.hstack: torch.hstack,
    np.linalg.norm: _norm,
    np.max: _reduction("amax"),
    np.mean: _reduction("mean"),
    np.min: _reduction("amin"),
    np.moveaxis: torch.movedim,
    np.nan_to_num: _nan_to_num,
    np.ndim: lambda a: a.ndim,
    np.ones_like: _like(1),
    np.prod: _reduction("prod"),
    np.ravel: torch.ravel,
    np.repeat: lambda x, repeats, axis=None: torch.repeat_interleave(x, repeats, dim=axis),
    np.reshape: lambda a, shape: torch.reshape(a, (shape,) if isinstance(shape, int) else shape),
    np.roll: lambda a, shift, axis=None: torch.roll(a, shift, axis),
    np.shape: lambda a: tuple(a.shape),
    np.sort: lambda a, axis=-1: torch.sort(a, axis).values,
    np.split: lambda x, sections, axis=0: list(torch.tensor_split(x, sections, dim=axis)),
    np.squeeze: lambda a, axis=None: torch.squeeze(a) if axis is None else torch.squeeze(a, axis),
    np.stack: lambda arrays, axis=0: torch.stack(tuple(arrays), axis),
    np.std: _moment("std"),
    np.sum: _reduction("sum"),
    np.swapaxes: torch.swapaxes,
    np.take: _take,
    np.take_along_axis: lambda arr, indices, axis: torch.take_along_dim(arr, indices, axis),
    np.transpose: lambda x, axes=None: torch.permute(x, axes or tuple(range(x.ndim))[::-1]),
    np.tile: lambda x, reps: torch.tile(x, (reps,) if isinstance(reps, int) else reps),
    np.var: _moment("var"),
    np.vstack: torch.vstack,
    np.where: _where,
    np.zeros_like: _like(0),
}
