"""Checks of what users give to `Env` and `VectorEnv`; nothing has changed when one raises."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from limberjack.utils.seeds import checked_seed
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "RENDER_MODES",
    "autoreset_mode",
    "check_options",
    "environment_arguments",
    "refuse_unknown",
    "render_mode",
    "reset_mask",
    "row_seeds",
    "task_arguments",
]

RENDER_MODES = ["rgb_array"]


# Any: a number, or a sequence of numbers and None.
def row_seeds(seed: Any, num_envs: int) -> list[int | None]:
    """The seed of each row: `seed + i` for one number, one each for a sequence.

    Raises:
      TypeError, ValueError: see `checked_seed`; or there are not `num_envs` of them.
    """
    if seed is None:
        return [None] * num_envs
    if np.ndim(seed) == 0:
        first = checked_seed(seed)
        checked_seed(first + num_envs - 1)
        return list(range(first, first + num_envs))
    if len(seed) != num_envs:
        raise ValueError(f"there are {len(seed)} seeds; expected {num_envs}: one for each row")
    return [None if one is None else checked_seed(one) for one in seed]


def check_options(options: object) -> None:
    """Raises TypeError if the options of a reset are neither a mapping nor None."""
    if options is not None and not isinstance(options, Mapping):
        raise TypeError(
            f"options is {options!r}; expected a mapping, such as {{'reset_mask': mask}}, or None"
        )


def reset_mask(options: Mapping[str, object] | None, num_envs: int) -> np.ndarray | None:
    """A copy of `options["reset_mask"]`; None if there is none.

    Raises:
      TypeError: it is no array of booleans, or the options are no mapping.
      ValueError: it is not (num_envs,), or selects no row.
    """
    check_options(options)
    mask = (options or {}).get("reset_mask")
    if mask is None:
        return None
    if not isinstance(mask, np.ndarray) or mask.dtype != bool:
        raise TypeError(f"reset_mask is {mask!r}; expected an array of booleans")
    if mask.shape != (num_envs,):
        raise ValueError(f"reset_mask has shape {mask.shape}; expected ({num_envs},)")
    if not mask.any():
        raise ValueError("reset_mask selects no row")
    return mask.copy()


def autoreset_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode, also by its value, such as 'SameStep'.

    Raises:
      ValueError: there is no such mode.
    """
    try:
        return AutoresetMode(mode)
    except ValueError:
        values = [each.value for each in AutoresetMode]
        raise ValueError(
            f"autoreset_mode is {mode!r}.{did_you_mean(mode, values)} Choose one of: "
            f"{', '.join(values)}, or a gymnasium.vector.AutoresetMode."
        ) from None


def render_mode(mode: str | None) -> str | None:
    """The mode, if there is one of that name.

    Raises:
      ValueError: there is none.
    """
    if mode is not None and mode not in RENDER_MODES:
        raise ValueError(
            f"render_mode is {mode!r}; expected None or one of: {', '.join(RENDER_MODES)}"
        )
    return mode


def refuse_unknown(kwargs: Mapping[str, object], *callables: Callable[..., object]) -> None:
    """Raises unless each name is a keyword that one of the callables takes.

    Raises:
      TypeError: one is not; with a suggestion.
    """
    known = [
        name
        for one in callables
        for name, parameter in inspect.signature(one).parameters.items()
        if parameter.kind is parameter.KEYWORD_ONLY
    ]
    for name in kwargs:
        if name not in known:
            raise TypeError(
                f"there is no argument {name!r}.{did_you_mean(name, known)} There are: "
                f"{', '.join(known)}."
            )


def task_arguments(
    task_kwargs: Mapping[str, object] | None, time_limit: float | None
) -> dict[str, object]:
    """`task_kwargs` with the time limit among them.

    Raises:
      TypeError: it is given twice.
    """
    return _with("time_limit", time_limit, task_kwargs, "task_kwargs")


def environment_arguments(
    environment_kwargs: Mapping[str, object] | None,
    randomize: Mapping[str, object] | None,
    pixels: Mapping[str, object] | None,
) -> dict[str, object]:
    """`environment_kwargs` with the randomisation and the pictures among them.

    Raises:
      TypeError: one is given twice.
    """
    kwargs = _with("randomize", randomize, environment_kwargs, "environment_kwargs")
    return _with("pixels", pixels, kwargs, "environment_kwargs")


def _with(
    name: str, value: object, kwargs: Mapping[str, object] | None, where: str
) -> dict[str, object]:
    """`kwargs` and one more, unless that is None."""
    known = dict(kwargs or {})
    if value is None:
        return known
    if name in known:
        raise TypeError(f"{name} is given twice: once alone and once in {where}")
    return {**known, name: value}
