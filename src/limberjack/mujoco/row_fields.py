"""`row_fields`: the model fields of which each row of a batch has its own values.

    fields = row_fields.of(batch, model, num_envs, ("body_pos",))
    fields.own["body_pos"][3] = positions           # of row 3
    fields.disable_actuation(rows)
    batch.forward(rows)
    fields.restore_actuation()

There are two implementations, and MuJoCo does not allow both in one batch:

- `Expanded`, for the fields in `mujoco.batch.MODEL_FIELDS`: the batch holds an array of each, and
  the rest of the model is shared.
- `RowModels`, if any other field differs, such as the heights of a terrain: each row has a whole
  model without textures. A quadruped on a terrain takes 0.38 MB per row: 0.22 MB of numbers, of
  which the terrain is 0.16 MB, and Python's view of each of the model's 500 arrays. Values are kept
  in the models only, unless a task reads a field of all rows at once.
"""

from collections.abc import Callable, Iterable, Mapping
from types import EllipsisType
from typing import Protocol

import mujoco
import mujoco.batch
import numpy as np
import numpy.typing as npt

from limberjack.mujoco.allocating import copy_of, data_of
from limberjack.mujoco.read_only import ReadOnly
from limberjack.mujoco.simulation import ACTUATION, Rows, read_field, write_field

__all__ = ["Expanded", "OwnField", "RowFields", "RowModels", "of"]

_READ_ONLY = (
    "{} of the model is read-only, since each row of this batch has a model of its own: set it in "
    "the task's initialize_episode, or draw it with environment_kwargs={{'randomize': ...}}"
)


_Index = int | slice | np.ndarray | EllipsisType


class OwnField(Protocol):
    """Values of a model field by row, (num_envs, ...): an array, or an object with its brackets."""

    def __getitem__(self, rows: _Index, /) -> np.ndarray: ...

    def __setitem__(self, rows: _Index, values: npt.ArrayLike, /) -> None: ...


class RowFields(Protocol):
    """Per-row model fields; see the module's docstring."""

    @property
    def own(self) -> Mapping[str, OwnField]:
        """The fields by name, live."""
        ...

    def shown(self, name: str) -> np.ndarray:
        """One of the own fields as an array, (num_envs, ...), that stays current."""
        ...

    def write(self, name: str, index: _Index, values: npt.ArrayLike) -> None:
        """Sets elements of an array of the model, which need not be an own field, in every row."""
        ...

    def disable_actuation(self, rows: Rows) -> None:
        """Disables actuation in these rows, at least."""
        ...

    def restore_actuation(self) -> None:
        """Sets the flags of all rows to those of the model; may be called repeatedly."""
        ...

    def set_const(self, rows: Rows) -> None:
        """Recomputes the constants that MuJoCo derives from other fields (mj_setConst)."""
        ...


def of(
    batch: mujoco.batch.Batch, model: mujoco.MjModel, num_envs: int, names: Iterable[str]
) -> RowFields:
    """The fields of a `mujoco.batch.Batch` of this model, in which nothing is expanded."""
    names = tuple(names)
    if all(name in mujoco.batch.MODEL_FIELDS for name in names):
        return Expanded(batch, names)
    return RowModels(batch, model, num_envs, names)


class Expanded:
    """Arrays in the batch; see `RowFields`."""

    def __init__(self, batch: mujoco.batch.Batch, names: Iterable[str]) -> None:
        self._batch = batch
        self.own: dict[str, np.ndarray] = {name: batch.expand(name) for name in names}
        self._disableflags: np.ndarray = batch.expand("opt.disableflags")
        self._flags = self._disableflags.copy()

    def shown(self, name: str) -> np.ndarray:
        """See `RowFields`; writable."""
        return self.own[name]

    def write(self, name: str, index: _Index, values: npt.ArrayLike) -> None:
        """See `RowFields`."""
        self._batch.expand(name)[:, index] = values

    def disable_actuation(self, rows: Rows) -> None:
        """See `RowFields`."""
        self._disableflags |= ACTUATION

    def restore_actuation(self) -> None:
        """See `RowFields`."""
        self._disableflags[...] = self._flags

    def set_const(self, rows: Rows) -> None:
        """See `RowFields`."""
        self._batch.set_const(rows)


class RowModels:
    """A model for each row; see `RowFields`.

    MuJoCo asks for the models to be set again whenever one was edited.
    """

    def __init__(
        self, batch: mujoco.batch.Batch, model: mujoco.MjModel, num_envs: int, names: Iterable[str]
    ) -> None:
        self._batch = batch
        self._models = [copy_of(model) for _ in range(num_envs)]
        self._data = data_of(model)  # for mj_setConst, which computes in it
        self._flags = model.opt.disableflags
        self.own: dict[str, _Values] = {
            name: _Values(self._models, name, self._set_models) for name in names
        }
        self._set_models()

    def _set_models(self) -> None:
        self._batch.set_models(self._models)

    def _of(self, rows: Rows) -> list[mujoco.MjModel]:
        return self._models if rows is None else [self._models[row] for row in rows]

    def shown(self, name: str) -> np.ndarray:
        """See `RowFields`; read-only."""
        return ReadOnly.of(self.own[name].array, _READ_ONLY.format(name))

    def write(self, name: str, index: _Index, values: npt.ArrayLike) -> None:
        """See `RowFields`."""
        for model in self._models:
            getattr(model, name)[index] = values
        self._set_models()

    def disable_actuation(self, rows: Rows) -> None:
        """See `RowFields`."""
        for model in self._of(rows):
            model.opt.disableflags |= ACTUATION
        self._set_models()

    def restore_actuation(self) -> None:
        """See `RowFields`."""
        for model in self._models:
            model.opt.disableflags = self._flags
        self._set_models()

    def set_const(self, rows: Rows) -> None:
        """See `RowFields`."""
        for model in self._of(rows):
            mujoco.mj_setConst(model, self._data)
        self._set_models()


class _Values:
    """A field of each row's model, which is indexed by rows, as an array (num_envs, ...) is."""

    def __init__(
        self, models: list[mujoco.MjModel], name: str, when_written: Callable[[], None]
    ) -> None:
        self._models, self._name, self._when_written = models, name, when_written
        self._numbers = np.arange(len(models))
        self._array: np.ndarray | None = None

    @property
    def array(self) -> np.ndarray:
        """The values of all rows, (num_envs, ...); from then on they are kept up to date."""
        if self._array is None:
            self._array = self[:]
        return self._array

    def __getitem__(self, rows: _Index, /) -> np.ndarray:
        numbers = self._numbers[rows]
        first = np.asarray(read_field(self._models[0], self._name))
        values = np.empty((*numbers.shape, *first.shape), first.dtype)
        each = _each(values, numbers)
        for i, number in enumerate(numbers.flat):
            each[i] = read_field(self._models[number], self._name)
        return values

    def __setitem__(self, rows: _Index, values: npt.ArrayLike, /) -> None:
        numbers = self._numbers[rows]
        shape = np.shape(read_field(self._models[0], self._name))
        values = np.broadcast_to(values, (*numbers.shape, *shape))
        for value, number in zip(_each(values, numbers), numbers.flat, strict=True):
            write_field(self._models[number], self._name, value)
        if self._array is not None:
            self._array[rows] = values
        self._when_written()


def _each(values: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """Values of rows with these numbers, (...) or (n, ...), as a view with one row for each."""
    return values if numbers.ndim else values[None]
