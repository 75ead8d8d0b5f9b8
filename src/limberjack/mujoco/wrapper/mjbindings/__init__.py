"""MuJoCo's enums, constants and functions under dm_control's module names."""

from limberjack.mujoco.wrapper.mjbindings import constants, enums, functions
from limberjack.mujoco.wrapper.mjbindings.functions import mjlib

__all__ = ["constants", "enums", "functions", "mjlib"]
