"""Pictures of a `Physics`: `render`, its keyword arguments, and the shape of its result."""

import inspect
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco import camera
from limberjack.mujoco.overlays import TextOverlay
from limberjack.mujoco.pictures import Style
from limberjack.utils.suggest import did_you_mean

__all__ = ["check_names", "picture_spec", "render"]

_Physics = Any  # `engine.Physics`; its module imports this one
_OF_STYLE = ("overlays", "depth", "segmentation", "render_flag_overrides", "quality")
# The keyword arguments of `Physics.render`, with their defaults.
_HOW = {p.name: p.default for p in list(inspect.signature(camera.render).parameters.values())[1:]}


# Any: arguments of `render`, each with its own type.
def picture_spec(physics: _Physics, given: Mapping[str, Any]) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and dtype of the picture that `render` returns for these arguments; draws nothing.

    Args:
      physics: a single simulation.
      given: keyword arguments of `Physics.render`.

    Raises:
      ValueError: there is no such camera or quality, the size is not positive or too large for the
        model, or the arguments are incompatible.
      TypeError: there is no such keyword.
    """
    check_names(given)
    how = {**_HOW, **given}
    Style.of(**{name: how[name] for name in _OF_STYLE})  # validates these arguments
    size = how["height"], how["width"]
    camera.Camera(physics, *size, camera_id=how["camera_id"], max_geom=1)  # validates the others
    if how["depth"]:
        return size, np.dtype(np.float32)
    if how["segmentation"]:
        return (*size, 2), np.dtype(np.int32)
    return (*size, 3), np.dtype(np.uint8)


def check_names(given: Mapping[str, object]) -> None:
    """Raises TypeError for a keyword that `Physics.render` does not accept."""
    for name in given:
        if name not in _HOW:
            raise TypeError(
                f"render got an unexpected keyword argument {name!r}.{did_you_mean(name, _HOW)} "
                f"It takes: {', '.join(_HOW)}."
            )


def render(
    physics: _Physics,
    height: int = 240,
    width: int = 320,
    camera_id: int | str = -1,
    overlays: Iterable[TextOverlay] = (),
    depth: bool = False,
    segmentation: bool = False,
    scene_option: mujoco.MjvOption | None = None,
    render_flag_overrides: Mapping[Any, bool] | None = None,  # names or numbers of MuJoCo's flags
    scene_callback: Callable[..., None] | None = None,
    quality: str = "full",
) -> np.ndarray:
    """A picture of the current state; see `limberjack.mujoco.camera.Camera.render`.

    Args:
      height: pixels.
      width: pixels.
      camera_id: name or number of a camera of the model; -1 is the free camera.
      overlays: `TextOverlay`s to draw on an RGB picture.
      depth: return depth in metres, (height, width) float32, instead of RGB.
      segmentation: return object id and `mjtObj` type, (height, width, 2) int32, -1 for the
        background, instead of RGB.
      scene_option: visualisation options, a `wrapper.MjvOption`.
      render_flag_overrides: rendering flags by name, such as {'wireframe': True}.
      scene_callback: called with the physics and the scene before it is drawn.
      quality: 'full', as in dm_control, or 'fast', without shadows, reflections and sky.

    Returns:
      (height, width, 3) uint8 unless `depth` or `segmentation` is set.
    """
    physics._refuse_rows("render()", "call render(rows, ...) of its BatchEnvironment")
    what = height, width, camera_id, overlays, depth, segmentation
    how = scene_option, render_flag_overrides, scene_callback, quality
    return camera.render(physics, *what, *how)
