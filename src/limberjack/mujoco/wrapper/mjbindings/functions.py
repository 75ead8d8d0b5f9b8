"""MuJoCo's functions: `mjlib` is the official `mujoco` module."""

from typing import Any

import mujoco

__all__ = ["mjlib"]

mjlib: Any = mujoco


def __getattr__(name: str) -> Any:
    """String tables such as `mjDISABLESTRING`."""
    return getattr(mujoco, name)
