"""Camera and size of a picture: validation of `render` arguments.

height, width = checked_size(physics, 240, 320)
view = view_of(physics, "side")     # for `mjv_updateScene`
"""

import operator
from typing import Protocol

import mujoco

from limberjack.mujoco.wrapper import MjData, MjModel, MjvCamera

__all__ = ["FREE_CAMERA", "Drawable", "checked_size", "view_of"]

FREE_CAMERA = -1  # used in place of a camera id


class Drawable(Protocol):
    """A simulation that can be drawn, such as `mujoco.Physics`."""

    @property
    def model(self) -> MjModel: ...

    @property
    def data(self) -> MjData: ...


def checked_size(physics: Drawable, height: int, width: int) -> tuple[int, int]:
    """Height and width as ints; ValueError unless they fit the model's off-screen buffer."""
    limits = physics.model._model.vis.global_
    sizes = []
    for name, value, limit in (("height", height, "offheight"), ("width", width, "offwidth")):
        most = getattr(limits, limit)
        try:
            size = operator.index(value)
        except TypeError:
            size = 0
        if size < 1:
            raise ValueError(
                f"image {name} is {value!r}; expected a whole number of pixels, from 1 to {most}"
            )
        if size > most:
            raise ValueError(
                f"image {name} {size} > {most}, the {name} of the model's off-screen buffer. Use "
                f'less, or enlarge it: <visual><global {limit}="{size}"/></visual> in the MJCF'
            )
        sizes.append(size)
    return sizes[0], sizes[1]


def view_of(physics: Drawable, camera_id: int | str) -> MjvCamera:
    """The view of a camera, given by name or number, or of the free camera."""
    model = physics.model._model
    if isinstance(camera_id, str):
        number: int = physics.model.name2id(camera_id, "camera")
    else:
        try:
            number = operator.index(camera_id)
        except TypeError:
            raise TypeError(
                f"camera_id is {camera_id!r}; expected the name or the number of a camera, or -1, "
                "the free camera"
            ) from None
    if not FREE_CAMERA <= number < model.ncam:
        raise ValueError(
            f"camera_id is {number}; expected a name, or a number from -1, the free camera, to "
            f"{model.ncam - 1}: the model has {model.ncam} cameras"
        )
    view = MjvCamera()
    view.fixedcamid = number
    if number == FREE_CAMERA:
        view.type = mujoco.mjtCamera.mjCAMERA_FREE
        mujoco.mjv_defaultFreeCamera(model, view)
    else:
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
    return view
