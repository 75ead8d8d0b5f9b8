"""Compiled models that simulations share, and copy when one of them is about to be changed.

    first = compiled(source, compile_it)
    assert compiled(source, compile_it) is first     # it was not called again

A model of the suite takes 12 MB, most of which is the sky, and about 70 ms to compile. So
simulations of the same source share one `SharedModel`, and the last ones that were used are kept
for the next load. Whoever could change it through an `MjModel` gets a copy first (`CopyOnWrite`):
an array that can be written, a nested struct, `ptr`. Code of this package that only reads uses
`model._model`, which stays shared.
"""

import collections
import copy
import weakref
from collections.abc import Callable, Hashable
from typing import Any

import mujoco

__all__ = ["CopyOnWrite", "SharedModel", "compiled"]

_MOST_KEPT = 256 * 2**20  # bytes of models that nobody may be using
_DISABLED = mujoco.mjtDisableBit.mjDSBL_ACTUATION.value

# What cannot be changed in place and so may be handed out of a shared model.
_IMMUTABLE = (int, float, str, bytes)

_in_use: "weakref.WeakValueDictionary[Hashable, SharedModel]" = weakref.WeakValueDictionary()
_last_used: "collections.OrderedDict[Hashable, SharedModel]" = collections.OrderedDict()


class SharedModel:
    """A compiled model that several simulations use and none may change, not even for a moment."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._passive: Callable[[], mujoco.MjModel | None] = lambda: None
        self.identities: dict[tuple[str, ...], int] = {}  # kept by `mujoco.identity`

    def passive(self) -> mujoco.MjModel:
        """The model with actuation disabled, for the forward pass after a reset.

        It lives as long as a simulation keeps it. It is a second model, because a flag that is
        switched in a shared one would reach other threads.
        """
        passive = self._passive()
        if passive is None:
            passive = copy.copy(self.model)
            passive.opt.disableflags |= _DISABLED
            self._passive = weakref.ref(passive)
        return passive


def compiled(source: Hashable, compile_it: Callable[[], mujoco.MjModel]) -> SharedModel:
    """The model that `compile_it` made for this source: now, or earlier if it is still there."""
    shared = _in_use.get(source)
    if shared is None:
        shared = _in_use[source] = SharedModel(compile_it())
    _last_used[source] = shared
    _last_used.move_to_end(source)
    sizes = [mujoco.mj_sizeModel(kept.model) for kept in _last_used.values()]
    while len(sizes) > 1 and sum(sizes) > _MOST_KEPT:
        _last_used.popitem(last=False)
        del sizes[0]
    return shared


class CopyOnWrite:
    """A wrapper of a model that is shared until somebody could change it."""

    # Any: the official struct's fields, which are not listed here.
    _model: Any
    _shared: SharedModel | None  # while it is shared

    def __init__(self, model: mujoco.MjModel | SharedModel) -> None:
        shared = model if isinstance(model, SharedModel) else None
        object.__setattr__(self, "_shared", shared)
        object.__setattr__(self, "_model", model if shared is None else shared.model)

    @property
    def ptr(self) -> mujoco.MjModel:
        """The official `mujoco.MjModel`, this wrapper's own."""
        if self._shared is not None:
            object.__setattr__(self, "_model", copy.copy(self._shared.model))
            object.__setattr__(self, "_shared", None)
        return self._model

    def _field(self, name: str) -> Any:
        """A field, of a model that is this wrapper's own if the field can be changed."""
        value = getattr(self._model, name)
        if self._shared is None or isinstance(value, _IMMUTABLE):
            return value
        return getattr(self.ptr, name)
