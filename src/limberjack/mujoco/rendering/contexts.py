"""`physics.contexts`, for programs that call MuJoCo's `mjr_` functions themselves."""

import contextlib
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol, Self, TypeVar

import mujoco

from limberjack.mujoco.rendering.thread import call
from limberjack.mujoco.wrapper import MjModel

__all__ = ["Contexts", "contexts"]


_T = TypeVar("_T")


class _HasModel(Protocol):
    """A physics with a model, such as `mujoco.Physics`."""

    @property
    def model(self) -> MjModel: ...


class Contexts(NamedTuple):
    """The type of `physics.contexts`, as in dm_control."""

    gl: "_GlContext"
    mujoco: "_MujocoContext"


class _GlContext:
    """The OpenGL context of a physics."""

    def __init__(self, physics: _HasModel) -> None:
        self._physics = physics

    @contextlib.contextmanager
    def make_current(self) -> Iterator[Self]:
        """An object whose `call` runs functions with the context current."""
        yield self

    def call(self, function: Callable[..., _T], *args: object, **kwargs: object) -> _T:
        """The result of `function(*args, **kwargs)`, called on the rendering thread."""
        model = self._physics.model.ptr
        return call(model, lambda _: function(*args, **kwargs), is_private=True)

    def free(self) -> None:
        """Leaves the context as it is: it is freed with the physics."""


class _MujocoContext:
    """MuJoCo's rendering context of a physics."""

    def __init__(self, physics: _HasModel) -> None:
        self._physics = physics

    @property
    def ptr(self) -> mujoco.MjrContext:
        """The official `mujoco.MjrContext`, for use within `contexts.gl`'s `call` only."""
        return call(self._physics.model.ptr, lambda context: context, is_private=True)

    def free(self) -> None:
        """Leaves the context as it is: it is freed with the physics."""


def contexts(physics: _HasModel) -> Contexts:
    """The rendering contexts of a physics, for programs that call MuJoCo's `mjr_` functions.

        with physics.contexts.gl.make_current() as context:
            context.call(
                mujoco.mjr_uploadTexture, physics.model.ptr, physics.contexts.mujoco.ptr, 0
            )

    Afterwards the physics no longer shares its model and contexts with others.
    """
    return Contexts(_GlContext(physics), _MujocoContext(physics))
