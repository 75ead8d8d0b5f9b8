"""Pictures of a `Physics`: what `render` takes, what shape a picture has, and one for each row."""

import inspect
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from limberjack.mujoco.camera import Camera, render
from limberjack.mujoco.rendering.pictures import Style
from limberjack.utils.suggest import did_you_mean

if TYPE_CHECKING:
    from limberjack.mujoco.engine import Physics

__all__ = ["check_names", "picture_spec"]

_OF_STYLE = ("overlays", "depth", "segmentation", "render_flag_overrides", "quality")
# The keyword arguments of `Physics.render`, with their defaults.
_HOW = {p.name: p.default for p in list(inspect.signature(render).parameters.values())[1:]}


# Any: each keyword has a type of its own.
def picture_spec(physics: "Physics", given: Mapping[str, Any]) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type of the picture that `render` gives with these arguments; draws nothing.

    Args:
      physics: a single simulation.
      given: keyword arguments of `Physics.render`.

    Raises:
      ValueError: there is no such camera or quality, or the size is not one that the model can
        have, or what is asked for cannot be combined.
      TypeError: there is no such keyword.
    """
    check_names(given)
    how = {**_HOW, **given}
    Style.of(**{name: how[name] for name in _OF_STYLE})  # checks them
    size = how["height"], how["width"]
    Camera(physics, *size, camera_id=how["camera_id"], max_geom=1)  # checks them
    if how["depth"]:
        return size, np.dtype(np.float32)
    if how["segmentation"]:
        return (*size, 2), np.dtype(np.int32)
    return (*size, 3), np.dtype(np.uint8)


def check_names(given: Mapping[str, object]) -> None:
    """Raises TypeError if `Physics.render` does not take a keyword."""
    for name in given:
        if name not in _HOW:
            raise TypeError(
                f"render got an unexpected keyword argument {name!r}.{did_you_mean(name, _HOW)} "
                f"It takes: {', '.join(_HOW)}."
            )
