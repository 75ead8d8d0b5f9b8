"""Checks of the arguments of `Env` and `VectorEnv`; nothing has changed when one raises."""

import functools
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ParamSpec, TypeVar

import numpy as np
from gymnasium.vector import AutoresetMode

from limberjack.mujoco.camera import check_names
from limberjack.rl.pixels import cameras_of, render_arguments
from limberjack.utils import suggest
from limberjack.utils.keywords import keywords, with_keywords
from limberjack.utils.seeds import checked_seed, first_of_seeds

__all__ = [
    "RENDER_MODES",
    "STATE",
    "autoreset_mode",
    "check_options",
    "is_batch",
    "picture_arguments",
    "refuse_unknown",
    "render_mode",
    "reset_mask",
    "row_seeds",
    "suggests_names",
]

RENDER_MODES = ["rgb_array"]
STATE = "state"  # the option of a reset that gives the state to begin in

_P = ParamSpec("_P")
_R = TypeVar("_R")
_WITH_NAMES = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


def suggests_names(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """The function, which answers an unknown keyword with the nearest name and a list.

    Python suggests names by itself from 3.13 on, without the list.
    """
    parameters = inspect.signature(function).parameters
    known = [n for n, p in parameters.items() if p.kind in _WITH_NAMES and n != "self"]

    @functools.wraps(function)
    def checked(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        suggest.check_names("got an unexpected keyword argument", kwargs, known)
        return function(*args, **kwargs)

    return checked


# Any: a number, or a sequence of numbers and None.
def row_seeds(seed: Any, num_envs: int) -> list[int | None]:
    """The seed of each row: `seed + i` for a number, the items of a sequence otherwise.

    Raises:
      TypeError, ValueError: see `first_of_seeds`; or a sequence has another length than `num_envs`.
    """
    if seed is None:
        return [None] * num_envs
    if np.ndim(seed) == 0:
        first = first_of_seeds(seed, num_envs)
        return list(range(first, first + num_envs))
    if len(seed) != num_envs:
        raise ValueError(f"there are {len(seed)} seeds; expected {num_envs}: one for each row")
    return [None if one is None else checked_seed(one) for one in seed]


def check_options(options: object, *known: str) -> Mapping[str, object]:
    """The options of a reset; empty for None.

    Args:
      options: a mapping, or None.
      known: the names of the options.

    Raises:
      TypeError: they are neither a mapping nor None, or one has another name.
    """
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        example = " and ".join(f"{name!r}" for name in known)
        raise TypeError(
            f"options is {options!r}; expected a mapping, which may have {example}, or None"
        )
    for name in options:
        if name not in known:
            raise TypeError(
                f"options has {name!r}, which reset does not take."
                f"{suggest.did_you_mean(name, known)} There are: {', '.join(known)}; nothing was "
                "reset."
            )
    return options


def reset_mask(
    options: Mapping[str, object] | None, num_envs: int, *others: str
) -> np.ndarray | None:
    """A copy of `options["reset_mask"]`; None without one.

    Args:
      options: of a reset.
      num_envs: number of rows.
      others: the names of the other options.

    Raises:
      TypeError: it is not an array of booleans, or see `check_options`.
      ValueError: its shape is not (num_envs,), or it selects no row.
    """
    mask = check_options(options, "reset_mask", *others).get("reset_mask")
    if mask is None:
        return None
    if not isinstance(mask, np.ndarray) or mask.dtype != bool:
        raise TypeError(f"reset_mask is {mask!r}; expected an array of booleans")
    if mask.shape != (num_envs,):
        raise ValueError(f"reset_mask has shape {mask.shape}; expected ({num_envs},)")
    if not mask.any():
        raise ValueError("reset_mask selects no row")
    return mask.copy()


def is_batch(given: object) -> bool:
    """Whether it has the interface of a `rl.batch_contract.Batch`, vectorised or not."""
    return all(hasattr(given, name) for name in ("num_envs", "begins", "set_states"))


def autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode, given as itself or by its value, such as 'SameStep'.

    Raises:
      ValueError: the mode is unknown.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        values = [each.value for each in AutoresetMode]
        raise ValueError(
            f"autoreset_mode is {mode!r}.{suggest.did_you_mean(mode, values)} Choose one of: "
            f"{', '.join(values)}, or a gymnasium.vector.AutoresetMode."
        ) from None


def render_mode(mode: str | None) -> str | None:
    """The mode itself.

    Raises:
      ValueError: the mode is unknown.
    """
    if mode is not None and mode not in RENDER_MODES:
        raise ValueError(
            f"render_mode is {mode!r}; expected None or one of: {', '.join(RENDER_MODES)}"
        )
    return mode


def refuse_unknown(kwargs: Mapping[str, object], *callables: Callable[..., object]) -> None:
    """Raise unless each name is a keyword-only argument of one of the callables.

    Raises:
      TypeError: one is not; the message suggests the nearest name.
    """
    known = [
        name
        for one in callables
        for name, parameter in inspect.signature(one).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY
    ]
    suggest.check_names("got an unexpected keyword argument", kwargs, known)


def picture_arguments(
    render_kwargs: Mapping[str, object] | None,
    width: int | None,
    height: int | None,
    camera_id: int | Sequence[int | str] | None,
    camera_name: str | Sequence[str] | None,
) -> dict[str, object]:
    """The keyword arguments of `Physics.render` for a picture, or of `render_cameras`.

    Args:
      render_kwargs: such arguments, with `camera` as another name for `camera_id`.
      width: pixels; None leaves it to `render_kwargs`.
      height: pixels; None leaves it to `render_kwargs`.
      camera_id: number of a camera, or a list of cameras; None leaves it to `camera_name` or
        `render_kwargs`.
      camera_name: name of a camera, or a list of names.

    Raises:
      TypeError: an argument is unknown, or given twice.
      ValueError: a list of cameras is empty.
    """
    if camera_id is not None and camera_name is not None:
        raise TypeError(
            f"camera_id is {camera_id!r} and camera_name is {camera_name!r}; expected one of them"
        )
    kwargs = render_arguments(keywords("render_kwargs", render_kwargs))
    check_names(kwargs)
    camera = camera_id if camera_name is None else camera_name
    kwargs = with_keywords("render_kwargs", kwargs, width=width, height=height, camera_id=camera)
    cameras_of(kwargs.get("camera_id", -1))
    return kwargs
