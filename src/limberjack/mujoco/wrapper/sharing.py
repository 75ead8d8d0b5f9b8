"""Compiled models shared by simulations, with copy-on-write.

    shared = compiled(source, compile_it)             # again from the cache, if it was compiled
    first, second = wrapper.MjModel(shared), wrapper.MjModel(shared)
    first.body_mass[1] = 2.0     # `first` now has its own copy

A suite model takes 12 MB, nearly all of it the sky texture, and 70 ms to compile. Simulations of
the same source share one `SharedModel`. The most recently used ones stay in a cache, up to a total
size, even if no simulation uses them. Any access through an `MjModel` that could lead to a change
(a writable array, a nested struct, `ptr`) copies the model first (`CopyOnWrite`). Code of this
package that only reads uses `model._official`.
"""

import functools
import weakref
from collections.abc import Callable, Hashable

import mujoco

from limberjack.mujoco.allocating import copy_of
from limberjack.mujoco.wrapper.textures import without_textures

__all__ = ["CopyOnWrite", "Mjcf", "SharedModel", "compiled", "drop_unused", "last_loaded"]

Mjcf = tuple[str | bytes, dict[str, bytes]]  # with contents of the files it refers to, by name

_MOST_KEPT = 128 * 2**20  # bytes; total size of the cached models
# Types that cannot be changed in place, so returning them needs no copy.
_IMMUTABLE = (int, float, str, bytes)


class SharedModel:
    """A compiled model used by several simulations; it must never change, not even temporarily."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.checksums: dict[tuple[str, ...], dict[str, int]] = {}  # of `model_values`
        self.mjcf: Mjcf | None = None  # if it was compiled from one

    @functools.cached_property
    def light(self) -> mujoco.MjModel:
        """The model without its textures."""
        return without_textures(self.model)

    @functools.cached_property
    def layout(self) -> mujoco.MjModel:
        """A copy of `light` that nothing is simulated with: `physics.data.ptr.model` shows it."""
        return copy_of(self.light)

    @functools.cached_property
    def passive(self) -> mujoco.MjModel:
        """The model with actuation disabled, for the forward pass after a reset.

        Toggling the flag in the shared model would affect other threads.
        """
        passive = copy_of(self.light)
        passive.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION.value
        return passive


class _LastLoaded:
    """The model that was most recently loaded from MJCF or URDF, by compiling it or from the cache.

    It is kept in memory, as dm_control's is.
    """

    def __init__(self) -> None:
        self.model: mujoco.MjModel | None = None  # with the changes made since
        self.mjcf: Mjcf | None = None
        self.is_parsed = False  # whether MuJoCo parsed it last; False if it is from the cache
        self._wrapper: Callable[[], CopyOnWrite | None] = lambda: None
        self._awaited: SharedModel | None = None

    def set(self, wrapper: "CopyOnWrite") -> None:
        """Records a wrapper whose model has just been parsed."""
        self._record(wrapper)
        self.is_parsed = True

    def expect(self, shared: SharedModel, is_parsed: bool) -> None:
        """Announces that the next wrapper of a shared model is the most recently loaded one."""
        self._awaited = shared
        self.is_parsed = is_parsed

    def follow(self, wrapper: "CopyOnWrite") -> None:
        """Takes notice of a new wrapper, or of one that has a new model."""
        awaited = self._awaited  # which another thread may replace
        if awaited is not None and wrapper._shared is awaited:
            self._record(wrapper)
        elif self._wrapper() is wrapper:
            self.model = wrapper._official

    def is_of(self, wrapper: "CopyOnWrite") -> bool:
        """Whether the wrapper has the most recently loaded model, not an equal or shared one."""
        is_private = wrapper._shared is None
        return self._wrapper() is wrapper or (is_private and wrapper._official is self.model)

    def _record(self, wrapper: "CopyOnWrite") -> None:
        self.model, self.mjcf = wrapper._official, wrapper._mjcf
        self._wrapper, self._awaited = weakref.ref(wrapper), None


last_loaded = _LastLoaded()


class CopyOnWrite:
    """A wrapper of a model that is shared until an access could change it."""

    _official: mujoco.MjModel
    _shared: SharedModel | None  # None once the wrapper has its own copy
    _is_lent: bool  # whether user code may change height fields, textures or meshes unnoticed
    _mjcf: Mjcf | None  # that it was compiled from; changes since are not in it

    def __init__(self, model: mujoco.MjModel | SharedModel, mjcf: Mjcf | None = None) -> None:
        shared = model if isinstance(model, SharedModel) else None
        object.__setattr__(self, "_mjcf", mjcf if shared is None else shared.mjcf)
        object.__setattr__(self, "_shared", shared)
        object.__setattr__(self, "_is_lent", shared is None)
        object.__setattr__(self, "_official", model if shared is None else shared.model)
        last_loaded.follow(self)

    @property
    def ptr(self) -> mujoco.MjModel:
        """The official `mujoco.MjModel`, not shared with other wrappers."""
        object.__setattr__(self, "_is_lent", True)
        return self.own()

    @property
    def _model(self) -> mujoco.MjModel:
        """The same, as programs for dm_control call it."""
        return self.ptr

    def own(self) -> mujoco.MjModel:
        """Like `ptr`, for code that does not change height fields, textures or meshes."""
        if self._shared is not None:
            object.__setattr__(self, "_official", copy_of(self._shared.model))
            object.__setattr__(self, "_shared", None)
            last_loaded.follow(self)
        return self._official

    @property
    def structure(self) -> mujoco.MjModel:
        """A model of the same sizes and names, for data and indices, which keep it in memory.

        It has no textures if the model is shared: a wrapper that later needs its own copy would
        otherwise keep them in memory twice.
        """
        return self._official if self._shared is None else self._shared.layout

    def _field(self, name: str) -> object:
        """A field; if it is mutable, the model is copied first."""
        value = getattr(self._official, name)
        return value if isinstance(value, _IMMUTABLE) else getattr(self.own(), name)


_in_use: "weakref.WeakValueDictionary[Hashable, SharedModel]" = weakref.WeakValueDictionary()
_last_used: dict[Hashable, SharedModel] = {}  # the most recent one last


def compiled(source: Hashable, compile_it: Callable[[], mujoco.MjModel]) -> SharedModel:
    """The cached model for this source, compiled by `compile_it` if necessary."""
    shared = _in_use.get(source)
    is_new = shared is None
    if shared is None:
        shared = _in_use[source] = SharedModel(compile_it())
    last_loaded.expect(shared, is_parsed=is_new)
    # Other threads may do the same at any point, so nothing relies on the entries found before.
    _last_used.pop(source, None)
    _last_used[source] = shared
    kept = [(name, mujoco.mj_sizeModel(each.model)) for name, each in tuple(_last_used.items())]
    total = sum(size for _, size in kept)
    for name, size in kept[:-1]:
        if total <= _MOST_KEPT:
            break
        _last_used.pop(name, None)
        total -= size
    return shared


def drop_unused() -> int:
    """Drops cached models that no simulation uses; returns how many are still in use."""
    _last_used.clear()
    return len(_in_use)
