"""MuJoCo's functions: `mjlib` is the official `mujoco` module."""

from typing import Any

import mujoco

__all__ = ["mjlib"]

mjlib = mujoco


def __getattr__(name: str) -> Any:  # names of MuJoCo's own package
    """Other names of the library, such as the string table `mjDISABLESTRING`."""
    return getattr(mujoco, name)
