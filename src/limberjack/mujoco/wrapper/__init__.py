"""MuJoCo objects for user code: models, data, visualisation structs and bindings."""

from limberjack.mujoco.wrapper import mjbindings
from limberjack.mujoco.wrapper.core import (
    Error,
    MjData,
    MjModel,
    MjvCamera,
    MjvFigure,
    MjvOption,
    MjvPerturb,
    MjvScene,
    callback_context,
    enable_timer,
    get_schema,
    save_last_parsed_model_to_xml,
    set_callback,
)

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
    "mjbindings",
    "save_last_parsed_model_to_xml",
    "set_callback",
]
