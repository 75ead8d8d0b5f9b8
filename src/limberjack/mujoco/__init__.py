"""MuJoCo for control tasks: `Physics`, cameras, and every name of the official package.

Importing it does not import OpenGL, which is loaded for the first frame.
"""

from typing import Any

# Must come first, so that every `import mujoco` below gets the official package without OpenGL.
from limberjack.mujoco import official as _official  # isort: split

from limberjack.mujoco.engine import (
    Camera,
    CameraMatrices,
    MovableCamera,
    Physics,
    TextOverlay,
    action_spec,
)
from limberjack.mujoco.rendering import RenderingError

__all__ = [
    "Camera",
    "CameraMatrices",
    "MovableCamera",
    "Physics",
    "RenderingError",
    "TextOverlay",
    "action_spec",
]


def __getattr__(name: str) -> Any:  # names of MuJoCo's own package
    """Names of the official package: `limberjack.mujoco.mj_step`, `limberjack.mujoco.mjtObj`."""
    return getattr(_official.mujoco, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *dir(_official.mujoco)})
