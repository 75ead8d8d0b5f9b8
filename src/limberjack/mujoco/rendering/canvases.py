"""OpenGL resources of models: created on first use, shared, and freed when no longer used.

    canvases = Canvases()
    canvases.draw(model, (240, 320), None, function, ())    # function(mjr_context)

An `MjrContext` holds a model's textures, meshes and buffers. Creating one takes a tenth of a second
and tens of megabytes, so models with equal resources share one. Each has its own OpenGL context,
because MuJoCo sets some OpenGL state, such as fog, only on creation. Models with the same structure
whose height fields, textures or meshes change also share one: differences are uploaded before each
picture. Everything here must run on one rendering thread.
"""

import collections
import hashlib
import weakref
from collections.abc import Callable
from typing import NamedTuple, TypeVar

import mujoco
import numpy as np

from limberjack.mujoco.allocating import allocating
from limberjack.mujoco.rendering import uploads
from limberjack.mujoco.rendering.backends import (
    Backend,
    RenderingError,
    open_backend,
    opened_again,
)

__all__ = ["Canvases", "share_changing"]

_FONT_SCALE = mujoco.mjtFontScale.mjFONTSCALE_150.value  # dm_control's
_OFFSCREEN = mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value
_PIXEL = 8  # bytes: colours, and depth of single precision
_PLANE = mujoco.mjtGeom.mjGEOM_PLANE.value
# Name prefixes of the fields that MuJoCo uploads to OpenGL.
_DRAWN_FIELDS = ("hfield_", "mat_tex", "mesh_", "skin_", "tex_")
# Number of different models that can be drawn in turn without recreating resources. With Mesa's
# software renderer each takes 75 MB.
_MOST_SHARED = 8


_T = TypeVar("_T")

# Models of which one canvas serves all with the same structure from the first picture on.
_changing: weakref.WeakSet[mujoco.MjModel] = weakref.WeakSet()


def share_changing(model: mujoco.MjModel) -> None:
    """Makes a model share one canvas with others like it, whatever their textures are.

    For models whose textures change with nearly every picture: otherwise each first gets a canvas
    of its own.
    """
    _changing.add(model)


class _Private:
    """Key of a canvas used by one model only."""


class _Shared(NamedTuple):
    """Key of a canvas shared by models with equal fingerprints."""

    fingerprint: bytes
    is_changing: bool  # the fingerprint excludes fields that are uploaded on change


class _Drawn(NamedTuple):
    """A model that was drawn, when it was last."""

    key: _Private | _Shared  # of its canvas
    planes: bytes  # which geoms were planes then; MuJoCo prepares a mesh for each


class Canvases:
    """The canvases of recently drawn models, and their backend."""

    def __init__(
        self,
        is_forked: bool = False,
        inherited: Backend | None = None,
        device: int | None = None,
    ) -> None:
        """Opens nothing yet; the arguments are those of `open_backend`."""
        self.backend: Backend | None = None
        self.device = device
        self._is_forked = is_forked
        self._inherited = inherited
        # Least recently used first.
        self._canvases: collections.OrderedDict[_Private | _Shared, _Canvas]
        self._canvases = collections.OrderedDict()
        self._drawn: weakref.WeakKeyDictionary[mujoco.MjModel, _Drawn]
        self._drawn = weakref.WeakKeyDictionary()
        self._selected: _Canvas | None = None
        self._in_use: tuple[_Canvas, mujoco.MjModel] | None = None

    def draw(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        may_have_changed: bool,
        when_gone: Callable[..., object] | None,
        function: Callable[..., _T],
        args: tuple[object, ...],
    ) -> _T:
        """Calls `function(mjr_context, *args)` with the model's canvas selected and up to date.

        Args:
          model: the official `mujoco.MjModel`.
          size: minimum height and width of the canvas, pixels.
          may_have_changed: whether the model's height fields, textures or meshes may have changed
            since it was first drawn.
          when_gone: if not None, the canvas is private to the model. Once the model is collected,
            in any thread, this is called with a function and its argument, which must then run on
            the rendering thread to free the canvas.
          function: the drawing function.
          args: its further arguments.

        Raises:
          RenderingError: OpenGL is not available.
        """
        canvas, outer = self._canvas(model, size, may_have_changed, when_gone), self._in_use
        self._select(canvas, model)
        self._in_use = canvas, model
        try:
            return function(canvas.mjr, *args)
        finally:
            self._in_use = outer
            if outer is not None:  # a nested call: return to the outer call's canvas
                self._select(*outer)

    def another_backend(self) -> Backend | None:
        """A backend for the canvases of another thread; see `opened_again`."""
        self._selected = None  # opening makes other contexts current
        return None if self.backend is None else opened_again(self.backend)

    def close(self) -> None:
        """Frees all canvases."""
        for key in list(self._canvases):
            self._drop(key)

    def _select(self, canvas: "_Canvas", model: mujoco.MjModel) -> None:
        if canvas is not self._selected:
            self._selected = None
            canvas.select()
            self._selected = canvas
        mujoco.mjr_setBuffer(_OFFSCREEN, canvas.mjr)
        if canvas.is_changing:
            canvas.uploads.update(model, canvas.mjr)

    def _canvas(
        self,
        model: mujoco.MjModel,
        size: tuple[int, int],
        may_have_changed: bool,
        when_gone: Callable[..., object] | None,
    ) -> "_Canvas":
        """The model's canvas: private, shared with equal models, or new."""
        drawn, planes = self._drawn.get(model), (model.geom_type == _PLANE).tobytes()
        key = None if drawn is None else drawn.key
        if when_gone is not None and not isinstance(key, _Private):
            key = _Private()
            weakref.finalize(model, when_gone, self._drop, key).atexit = False
        canvas = None if key is None else self._canvases.get(key)
        is_outdated = drawn is not None and drawn.planes != planes
        if canvas is not None and (is_outdated or not canvas.has_room(size)):
            # The model's off-screen buffer was enlarged since, or its geoms have other types. A
            # shared canvas stays for others.
            if isinstance(key, _Private):
                self._drop(key)
            canvas = None
        if not isinstance(key, _Private):
            is_changing = model in _changing or (key is not None and key.is_changing)
            if may_have_changed and canvas is not None and not is_changing:
                is_changing = not canvas.uploads.are_current(model)
            if canvas is None or canvas.is_changing != is_changing:
                key, canvas = _Shared(_fingerprint(model, is_changing), is_changing), None
        assert key is not None
        self._drawn[model] = _Drawn(key, planes)
        if key not in self._canvases:
            self._canvases[key] = self._new_canvas(model, isinstance(key, _Private) or key[1])
        self._canvases.move_to_end(key)
        return self._canvases[key]

    def _new_canvas(self, model: mujoco.MjModel, is_changing: bool) -> "_Canvas":
        if self.backend is None:
            self.backend = open_backend(self._is_forked, self._inherited, self.device)
        shared = [key for key in self._canvases if not isinstance(key, _Private)]
        for oldest in shared[: max(0, len(shared) + 1 - _MOST_SHARED)]:
            self._drop(oldest)
        self._selected = None
        return _Canvas(self.backend, model, is_changing)

    def _drop(self, key: _Private | _Shared) -> None:
        canvas = self._canvases.pop(key, None)
        if canvas is not None:
            self._selected = None
            canvas.free()


class _Canvas:
    """An OpenGL context with MuJoCo's resources for a model.

    Attributes:
      mjr: MuJoCo's rendering context.
      uploads: the values that it holds.
      is_changing: whether changed values are uploaded before each picture.
    """

    def __init__(self, backend: Backend, model: mujoco.MjModel, is_changing: bool) -> None:
        self.is_changing = is_changing
        self._backend = backend
        self._context = backend.create()
        if not self._context:
            raise RenderingError(
                f"{backend.renderer!r} could not create another OpenGL context: free environments "
                "that have rendered, or use fewer models"
            )
        self.select()
        try:
            with allocating("a model's textures and buffers", _bytes_of(model)):
                self.mjr = mujoco.MjrContext(model, _FONT_SCALE)
        except (mujoco.FatalError, MemoryError) as error:
            backend.make_current(None)
            backend.destroy(self._context)
            if isinstance(error, MemoryError):
                raise
            size = f"{model.vis.global_.offheight} by {model.vis.global_.offwidth}"
            raise RenderingError(
                f"{backend.renderer!r} cannot draw into the model's off-screen buffer of {size} "
                f"pixels, which may exceed its limits: {error}"
            ) from error
        self.uploads = uploads.Uploads(model)

    def has_room(self, size: tuple[int, int]) -> bool:
        """Whether a picture of this height and width fits into the buffer."""
        return size[0] <= self.mjr.offHeight and size[1] <= self.mjr.offWidth

    def select(self) -> None:
        """Makes its OpenGL context current."""
        self._backend.make_current(self._context)

    def free(self) -> None:
        """Frees everything; afterwards no context is current."""
        self.select()  # MuJoCo frees resources by id, and ids are specific to a context
        self.mjr.free()
        self._backend.make_current(None)
        self._backend.destroy(self._context)


def _bytes_of(model: mujoco.MjModel) -> int:
    """Bytes of a model's textures and of its off-screen buffer, in colour and depth."""
    size = model.vis.global_
    return model.ntexdata + size.offheight * size.offwidth * _PIXEL


def _fingerprint(model: mujoco.MjModel, is_changing: bool) -> bytes:
    """Equal for two models whose OpenGL resources are equal.

    Resources depend on textures, meshes, height fields, skins, planes and visual settings, but not
    on positions and colours.

    Args:
      model: the model.
      is_changing: whether to leave out fields that are uploaded on change.
    """
    digest = hashlib.blake2b(digest_size=16)
    planes = model.geom_type == _PLANE
    fields: dict[str, object] = {
        "vis": repr(model.vis),
        "extent": model.stat.extent,
        "plane sizes": model.geom_size[planes],
        "plane materials": model.geom_matid[planes],
    }
    for name in dir(model):
        if name.startswith(_DRAWN_FIELDS):
            fields[name] = getattr(model, name)
    for name, value in fields.items():
        if not isinstance(value, np.ndarray):
            digest.update(f"{name} {value!r}".encode())
            continue
        digest.update(f"{name} {value.dtype} {value.shape}".encode())
        if not (is_changing and name in uploads.FIELDS):
            digest.update(np.ascontiguousarray(value).data)
    return digest.digest()
