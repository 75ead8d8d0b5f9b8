"""OpenGL rendering on dedicated threads: from a scene to an array of pixels."""

from limberjack.mujoco.rendering.backends import RenderingError
from limberjack.mujoco.rendering.canvases import share_changing
from limberjack.mujoco.rendering.contexts import Contexts, contexts
from limberjack.mujoco.rendering.thread import (
    Pending,
    backend,
    call,
    num_threads,
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
    "num_threads",
    "prepare",
    "share_changing",
    "use_device",
]
