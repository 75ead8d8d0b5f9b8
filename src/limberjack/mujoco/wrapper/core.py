"""The contents of `wrapper` except the bindings, under dm_control's module name."""

import contextlib
import time
from collections.abc import Callable, Iterator

import mujoco

from limberjack.mujoco.wrapper.data import MjData
from limberjack.mujoco.wrapper.model import (
    Error,
    MjModel,
    save_last_parsed_model_to_xml,
)
from limberjack.mujoco.wrapper.visual import MjvCamera, MjvFigure, MjvOption, MjvPerturb, MjvScene

mjlib = mujoco  # dm_control's name for it

_Callback = Callable[..., object] | int | None  # an int is a function's address

__all__ = [
    "Error",
    "MjData",
    "MjModel",
    "MjvCamera",
    "MjvFigure",
    "MjvOption",
    "MjvPerturb",
    "MjvScene",
    "callback_context",
    "enable_timer",
    "get_schema",
    "mjlib",
    "save_last_parsed_model_to_xml",
    "set_callback",
]


def set_callback(name: str, new_callback: _Callback = None) -> None:
    """Installs a MuJoCo callback: a callable or a ctypes function; None removes it."""
    getattr(mujoco, f"set_{name}")(new_callback)


@contextlib.contextmanager
def callback_context(name: str, new_callback: _Callback = None) -> Iterator[None]:
    """Installs a MuJoCo callback within the context."""
    before = getattr(mujoco, f"get_{name}")()
    set_callback(name, new_callback)
    try:
        yield
    finally:
        set_callback(name, before)


def enable_timer(enabled: bool = True) -> None:
    """Enables or disables MuJoCo's stage timers, based on the wall clock."""
    set_callback("mjcb_time", time.time if enabled else None)


def get_schema() -> str:
    """The elements and attributes that MuJoCo's XML parser supports, as text."""
    return mujoco.mj_printSchema(False, False)
