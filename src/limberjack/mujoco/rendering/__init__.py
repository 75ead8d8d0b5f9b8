"""OpenGL rendering on a dedicated thread: from a scene to an array of pixels."""

from limberjack.mujoco.rendering.backends import RenderingError
from limberjack.mujoco.rendering.canvases import share_changing
from limberjack.mujoco.rendering.contexts import Contexts, contexts
from limberjack.mujoco.rendering.thread import backend, call, use_device

__all__ = [
    "Contexts",
    "RenderingError",
    "backend",
    "call",
    "contexts",
    "share_changing",
    "use_device",
]
