"""What user code touches of MuJoCo: models, data, the visualisation structs and bindings."""

from limberjack.mujoco.wrapper import mjbindings
from limberjack.mujoco.wrapper.core import (
    Error,
    MjData,
    MjModel,
    callback_context,
    enable_timer,
    set_callback,
)
from limberjack.mujoco.wrapper.visual import MjvCamera, MjvFigure, MjvOption, MjvPerturb, MjvScene

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
    "mjbindings",
    "set_callback",
]
