"""`Uploads`: keeps a model's height fields, textures and meshes in OpenGL up to date.

    uploads = Uploads(model)            # created together with the MjrContext, with equal values
    uploads.update(model, context)      # uploads the objects that have changed

Changes are found by comparing bytes. For 12 MB of textures this takes half a millisecond or more,
so `canvases.py` checks only models that user code may have changed. Other resources, such as the
sizes of planes, are uploaded once.
"""

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

__all__ = ["FIELDS", "Uploads"]


class _Kind(NamedTuple):
    """A kind of object that MuJoCo can upload individually."""

    size: str  # field of the model: number of objects
    fields: tuple[str, ...]  # values that are uploaded
    upload: Callable[[mujoco.MjModel, mujoco.MjrContext, int], None]


# Sizes of textures and their place in `tex_data`.
_TEXTURES = ("tex_height", "tex_width", "tex_nchannel", "tex_adr")
_FLAT = mujoco.mjtTexture.mjTEXTURE_2D.value
_FACES = 6  # of a cube whose height is not its width
_KINDS = (
    _Kind("nhfield", ("hfield_size", "hfield_data"), mujoco.mjr_uploadHField),
    _Kind("ntex", ("tex_data", *_TEXTURES), mujoco.mjr_uploadTexture),
    _Kind("nmesh", ("mesh_vert", "mesh_normal", "mesh_texcoord"), mujoco.mjr_uploadMesh),
)
# Fields of the model whose changes are uploaded.
FIELDS = tuple(name for kind in _KINDS for name in kind.fields)


class Uploads:
    """The values held by one `MjrContext`, and their update when the model's values change."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Records the values of the model from which the context was just created."""
        self._held = {name: getattr(model, name).copy() for name in FIELDS}

    def are_current(self, model: mujoco.MjModel) -> bool:
        """Whether the context holds the model's current values.

        Args:
          model: a model with the same structure, so that the fields have the same shapes.
        """
        return all(_are_same(getattr(model, name), held) for name, held in self._held.items())

    def update(self, model: mujoco.MjModel, context: mujoco.MjrContext) -> None:
        """Uploads the objects whose values differ from those in the context.

        Args:
          model: as for `are_current`.
          context: the `MjrContext`; its OpenGL context must be current.
        """
        for kind in _KINDS:
            changed = [
                name
                for name in kind.fields
                if not _are_same(getattr(model, name), self._held[name])
            ]
            for number in range(getattr(model, kind.size) if changed else 0):
                if any(self._differ(model, name, number) for name in changed):
                    kind.upload(model, context, number)
            for name in changed:
                np.copyto(self._held[name], getattr(model, name))

    def _differ(self, model: mujoco.MjModel, name: str, number: int) -> bool:
        """Whether one object's values of a field have changed."""
        part = _part(model, name, number)
        now, held = getattr(model, name).reshape(-1)[part], self._held[name].reshape(-1)[part]
        return not _are_same(now, held)


def _part(model: mujoco.MjModel, name: str, number: int) -> slice:
    """The slice of a field's flat values that belongs to one object."""
    columns = 1
    if name == "hfield_size":
        start, count, columns = number, 1, model.hfield_size.shape[1]
    elif name == "hfield_data":
        start = model.hfield_adr[number]
        count = int(model.hfield_nrow[number]) * int(model.hfield_ncol[number])
    elif name in _TEXTURES:
        start, count = number, 1
    elif name == "tex_data":
        start = model.tex_adr[number]
        height, width = int(model.tex_height[number]), int(model.tex_width[number])
        if height != width and model.tex_type[number] != _FLAT:
            height = _FACES * width
        count = height * width * int(model.tex_nchannel[number])
    else:  # such as mesh_vert, with mesh_vertnum rows from mesh_vertadr for each object
        start, count = getattr(model, f"{name}adr")[number], getattr(model, f"{name}num")[number]
        columns = getattr(model, name).shape[1]
    return slice(int(start) * columns, (int(start) + int(count)) * columns)


def _are_same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two contiguous arrays have the same bytes."""
    # Compares the largest words that fit, three times as fast as single bytes.
    size = next(size for size in (8, 4, 2, 1) if one.nbytes % size == 0)
    word = np.dtype(f"u{size}")
    return np.array_equal(one.reshape(-1).view(word), other.reshape(-1).view(word))
