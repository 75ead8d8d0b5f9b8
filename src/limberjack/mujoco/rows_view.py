"""`RowsData` and `RowsModel`: the types of `physics.data` and `physics.model` in a batch.

    physics.data.qpos          # (num_envs, nq), live
    physics.model.body_mass    # (num_envs, nbody) if rows have their own, else (nbody,), read-only

They have the fields of the official structs, with one row per simulation. They cannot be stepped.
"""

import copy
from typing import Any

import mujoco

from limberjack.mujoco.read_only import ReadOnlyStruct
from limberjack.mujoco.simulation import Fields
from limberjack.mujoco.wrapper.core import MjModel

__all__ = ["RowsData", "RowsModel"]


class RowsData:
    """The fields of a batch's MjData."""

    def __init__(self, fields: Fields) -> None:
        vars(self)["_fields"] = fields
        vars(self)["model"] = RowsModel(fields)

    @property
    def _data(self) -> "RowsData":
        """This object, in place of the official data that a single simulation's wrapper has."""
        return self

    def __getattr__(self, name: str) -> Any:  # Any: fields of the official struct
        if name == "_fields":  # not yet set, as while copying: avoids infinite recursion
            raise AttributeError(name)
        try:
            field = self._fields.data_field(name)[0]
        except AttributeError:
            raise AttributeError(
                f"the data of a batch has no {name!r}; it has the arrays of mujoco.MjData, with "
                "one row per simulation"
            ) from None
        if callable(field):
            raise AttributeError(f"a batch has no data.{name}(...): use the methods of physics")
        if hasattr(field, "shape"):
            vars(self)[name] = field  # cached: the array stays the same while the batch lives
        return field

    def __setattr__(self, name: str, value: object) -> None:
        self._fields.data_field(name)[0][...] = value


class RowsModel(MjModel):
    """The fields of a batch's MjModel; per-row fields have a leading batch axis."""

    def __init__(self, fields: Fields) -> None:
        object.__setattr__(self, "_fields", fields)
        object.__setattr__(self, "_model", fields.model._model)
        object.__setattr__(self, "_shared", fields.model._shared)

    def __getattr__(self, name: str) -> Any:  # Any: fields of the official struct
        if name in ("_fields", "_model", "_shared"):  # not yet initialised
            raise AttributeError(name)
        field = self._fields.model_field(name)[0]
        if hasattr(field, "shape") or isinstance(field, int | float | str | bytes):
            return field
        if callable(field):
            raise AttributeError(f"a batch has no model.{name}(...): use physics.named.model")
        return ReadOnlyStruct(field, name)

    def __setattr__(self, name: str, value: object) -> None:
        field = self._fields.model_field(name)[0]
        if not hasattr(field, "shape"):
            raise ValueError(
                f"{name} of the model is shared by all rows and read-only: change it before "
                "creating the batch"
            )
        field[...] = value

    @property
    def ptr(self) -> mujoco.MjModel:
        """A copy of the official model shared by the rows; changes to it affect no row."""
        return copy.copy(self._model)

    def __copy__(self) -> MjModel:
        return self._fields.model.copy()
