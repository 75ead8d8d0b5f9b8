"""Compiled models that simulations share, and copy when one of them is about to be changed.

    shared = SharedModel(official)
    first, second = wrapper.MjModel(shared), wrapper.MjModel(shared)
    first.body_mass[1] = 2.0     # from here on the first one has a copy

A model of the suite takes 12 MB, nearly all of it the sky. Simulations of the same source share one
`SharedModel`; see `compiled`. An access that could change it through an `MjModel` copies it first
(`CopyOnWrite`): an array that can be written, a nested struct, `ptr`. Code of this package that
reads uses `model._model`.
"""

import copy
import functools
from typing import Any

import mujoco

from limberjack.mujoco.wrapper.textures import without_textures

__all__ = ["CopyOnWrite", "SharedModel"]


# What cannot be changed in place and so may be handed out of a shared model.
_IMMUTABLE = (int, float, str, bytes)


class SharedModel:
    """A compiled model that several simulations use and none may change, not even for a moment."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.checksums: dict[tuple[str, ...], dict[str, int]] = {}  # of `mujoco.identity`

    @functools.cached_property
    def light(self) -> mujoco.MjModel:
        """The model without its textures."""
        return without_textures(self.model)

    @functools.cached_property
    def passive(self) -> mujoco.MjModel:
        """The same with actuation disabled, for the forward pass after a reset.

        A flag that is switched in a model that is shared would reach other threads.
        """
        passive = copy.copy(self.light)
        passive.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION.value
        return passive


class CopyOnWrite:
    """A wrapper of a model that is shared until somebody could change it."""

    _model: Any  # has the official struct's fields, which are not listed here
    _shared: SharedModel | None  # while it is shared
    _is_lent: bool  # whether others may change what is drawn of it, unnoticed

    def __init__(self, model: mujoco.MjModel | SharedModel) -> None:
        shared = model if isinstance(model, SharedModel) else None
        object.__setattr__(self, "_shared", shared)
        object.__setattr__(self, "_is_lent", shared is None)
        object.__setattr__(self, "_model", model if shared is None else shared.model)

    @property
    def ptr(self) -> mujoco.MjModel:
        """The official `mujoco.MjModel`, this wrapper's own."""
        object.__setattr__(self, "_is_lent", True)
        return self.own()

    def own(self) -> mujoco.MjModel:
        """As `ptr`, for code that changes no height field, texture or mesh."""
        if self._shared is not None:
            object.__setattr__(self, "_model", copy.copy(self._shared.model))
            object.__setattr__(self, "_shared", None)
        return self._model

    def _field(self, name: str) -> Any:
        """A field, of a model that is this wrapper's own if the field can be changed."""
        value = getattr(self._model, name)
        return value if isinstance(value, _IMMUTABLE) else getattr(self.own(), name)
