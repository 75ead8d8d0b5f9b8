"""OpenGL rendering on a dedicated thread: from a scene to an array of pixels."""

from limberjack.mujoco.rendering.backends import RenderingError
from limberjack.mujoco.rendering.canvases import share_changing
from limberjack.mujoco.rendering.contexts import Contexts, contexts
from limberjack.mujoco.rendering.thread import (
    Pending,
    backend,
    call,
    prepare,
    use_device,
)

__all__ = [
    "Contexts",
    "Pending",
    "RenderingError",
    "backend",
    "call",
    "contexts",
    "prepare",
    "share_changing",
    "use_device",
]
