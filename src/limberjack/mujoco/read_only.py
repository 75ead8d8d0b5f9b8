"""`ReadOnly` and `ReadOnlyStruct`: read-only views whose write errors say what to do instead.

    masses = ReadOnly.of(model.body_mass, "body_mass is shared by all rows: use randomize")
    masses[0] = 2.0     # ValueError with that message
    masses.copy()[0] = 2.0

A view shares the memory of its array, so it always has the current values. Results of arithmetic
are ordinary arrays.
"""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np

from limberjack.utils.arrays import AnyArray

__all__ = ["ReadOnly", "ReadOnlyStruct"]

_COMMON = (
    "{} is shared by all rows and read-only: change it before creating the batch, or use randomize"
)


class ReadOnly(np.ndarray):
    """A read-only view of an array; see the module's docstring."""

    _advice = ""

    @classmethod
    def of(cls, array: np.ndarray, advice: str) -> Self:
        """A read-only view of `array`; writing to it raises ValueError with the text `advice`."""
        view = array.view(cls)
        view._advice = advice
        view.flags.writeable = False
        return view

    def __array_finalize__(self, source: object) -> None:
        self._advice = getattr(source, "_advice", "")

    def __setitem__(self, key: AnyArray, value: AnyArray) -> None:
        self._refuse_writing()
        super().__setitem__(key, value)

    # Any: of a ufunc, each with its own type.
    def __array_ufunc__(
        self, ufunc: np.ufunc, method: str, *inputs: AnyArray, **kwargs: Any
    ) -> AnyArray:
        for out in kwargs.get("out", ()):
            if isinstance(out, ReadOnly):
                out._refuse_writing()
        if "out" in kwargs:
            kwargs["out"] = tuple(map(_plain, kwargs["out"]))
        return getattr(ufunc, method)(*map(_plain, inputs), **kwargs)

    def _refuse_writing(self) -> None:
        if not self.flags.writeable:
            raise ValueError(self._advice)


def _plain(value: object) -> object:
    return value.view(np.ndarray) if isinstance(value, ReadOnly) else value


class ReadOnlyStruct:
    """A read-only view of a struct, such as `mujoco.MjOption`."""

    def __init__(
        self, struct: object, name: str, own: Mapping[str, AnyArray] | None = None
    ) -> None:
        """Wraps a struct.

        Args:
          struct: the struct.
          name: its name, for messages.
          own: fields that differ per row, (num_envs, ...), which take the place of the struct's and
            may be writable.
        """
        vars(self).update(_struct=struct, _name=name, _own=own or {})

    def __getattr__(self, name: str) -> Any:  # attributes of the struct
        if name.startswith("_"):  # including those of an object not yet initialised
            raise AttributeError(name)
        if name in self._own:
            return self._own[name]
        value = getattr(self._struct, name)
        if isinstance(value, np.ndarray):
            return ReadOnly.of(value, _COMMON.format(f"{self._name}.{name}"))
        return value

    def __setattr__(self, name: str, value: object) -> None:
        if name in self._own:
            self._own[name][...] = value
            return
        raise ValueError(_COMMON.format(f"{self._name}.{name}"))
