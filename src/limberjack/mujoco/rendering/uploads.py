"""The height fields, textures and meshes that OpenGL holds of a model, and which are out of date.

    uploads = Uploads(model)            # made together with the MjrContext, which holds the same
    uploads.update(model, context)      # uploads the objects that differ now

Changes are found by comparing bytes. 12 MB of textures take half a millisecond or more, so
`canvases.py` asks only for models that somebody may have changed. Whatever else MuJoCo takes to
OpenGL, such as the size of a plane, it takes once.
"""

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

__all__ = ["FIELDS", "Uploads"]


class _Kind(NamedTuple):
    """A kind of object that MuJoCo can upload by itself."""

    size: str  # field of the model: number of objects
    fields: tuple[str, ...]  # values that are uploaded
    upload: Callable[[mujoco.MjModel, mujoco.MjrContext, int], None]


_KINDS = (
    _Kind("nhfield", ("hfield_size", "hfield_data"), mujoco.mjr_uploadHField),
    _Kind("ntex", ("tex_data",), mujoco.mjr_uploadTexture),
    _Kind("nmesh", ("mesh_vert", "mesh_normal", "mesh_texcoord"), mujoco.mjr_uploadMesh),
)
# Fields of the model whose changes are uploaded.
FIELDS = tuple(name for kind in _KINDS for name in kind.fields)


class Uploads:
    """The values that one `MjrContext` holds, and their upload when a model has others."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Takes the values of the model that the context has just been made of."""
        self._held = {name: getattr(model, name).copy() for name in FIELDS}

    def are_current(self, model: mujoco.MjModel) -> bool:
        """Whether the context holds the model's present values.

        Args:
          model: of the same structure: the fields have the same shapes.
        """
        return all(_are_same(getattr(model, name), held) for name, held in self._held.items())

    def update(self, model: mujoco.MjModel, context: mujoco.MjrContext) -> None:
        """Uploads the objects whose values differ from those that the context holds.

        Args:
          model: as for `are_current`.
          context: whose OpenGL context is current.
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
        """Whether one object's values of a field differ."""
        part = _part(model, name, number)
        now, held = getattr(model, name).reshape(-1)[part], self._held[name].reshape(-1)[part]
        return not _are_same(now, held)


def _part(model: mujoco.MjModel, name: str, number: int) -> slice:
    """The part of a field's flat values that is one object's."""
    columns = 1
    if name == "hfield_size":
        start, count, columns = number, 1, model.hfield_size.shape[1]
    elif name == "hfield_data":
        start = model.hfield_adr[number]
        count = int(model.hfield_nrow[number]) * int(model.hfield_ncol[number])
    elif name == "tex_data":
        start = model.tex_adr[number]
        count = int(model.tex_height[number]) * int(model.tex_width[number])
        count *= int(model.tex_nchannel[number])
    else:  # mesh_vert, whose objects begin at mesh_vertadr and have mesh_vertnum rows, and the like
        start, count = getattr(model, f"{name}adr")[number], getattr(model, f"{name}num")[number]
        columns = getattr(model, name).shape[1]
    return slice(int(start) * columns, (int(start) + int(count)) * columns)


def _are_same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two contiguous arrays have the same bytes."""
    # In the largest words that fit: three times as fast as by single bytes.
    size = next(size for size in (8, 4, 2, 1) if one.nbytes % size == 0)
    word = np.dtype(f"u{size}")
    return np.array_equal(one.reshape(-1).view(word), other.reshape(-1).view(word))
