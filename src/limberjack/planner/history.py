"""`History`: a record of a batch's simulations at several steps, read as one batch.

    history = History(rollouts.simulation, steps=25)
    seen = history.read_by(rollouts.physics)  # the same kind of Physics, to be read only
    for step in range(25):
        rollouts.step(2)
        history.record(step)
    seen.named.data.xpos["head", "z"]  # (25 * num_envs,), the first step's first

Quantities of all steps cost hardly more time than those of one, most of which is Python's. Only
fields that are read are recorded, and of those that are read by names only the columns in use. They
are known after the first reading, which makes `history.is_complete` False.
"""

from collections.abc import Callable, Iterator
from typing import Any, NoReturn, TypeVar

import numpy as np

from limberjack.mujoco.batch_simulation import BatchSimulation
from limberjack.mujoco.engine import Physics
from limberjack.mujoco.index import Axes, FieldIndexer, NamedFields, NamedIndexStructs, Names

__all__ = ["History"]

_Physics = TypeVar("_Physics", bound=Physics)  # the domain's own class
_Field = tuple[np.ndarray, bool]  # and whether each simulation has values of its own
_Key = tuple[str, str]  # what reads a field, and its name
_DATA, _BY_NAMES, _MODEL = "data", "data by names", "model"


class History:
    """See the module's docstring.

    Attributes:
      is_complete: whether all fields read since `begin` had been recorded.
      num_envs: number of recorded states.
      num_last: number of states of the last step.
    """

    def __init__(self, simulation: BatchSimulation, steps: int) -> None:
        """Creates a record of a batch; nothing is recorded yet."""
        self._simulation, self._steps = simulation, steps
        self.num_last = simulation.num_envs or 1  # states of one step
        self.num_envs: int | None = steps * self.num_last
        self._kept: dict[_Key, np.ndarray] = {}  # (steps, num_envs, columns) each
        self._wanted: dict[_Key, np.ndarray] = {}  # whether a column is read, (columns,)
        self._parts: dict[_Key, list[slice]] = {}  # of the columns that are recorded
        self.begin()

    def begin(self) -> None:
        """Begins a new record."""
        self.is_complete = True
        # Columns here and in the batch, (..., num_envs, columns) each; set by the first step.
        self._live: list[tuple[np.ndarray, np.ndarray]] = []

    def record(self, step: int) -> None:
        """Records the batch's current quantities as those of a step, from 0 on."""
        self._live = self._live or list(self._pairs(self._now))
        for kept, live in self._live:
            kept[step] = live

    def record_all(self, values_of: Callable[[str, slice], np.ndarray]) -> None:
        """Records all steps; `values_of` gives columns of a field, (steps, num_envs, columns)."""

        def of_key(key: _Key, part: slice) -> np.ndarray:
            return self._now(key, part) if key[0] == _MODEL else values_of(key[1], part)

        for kept, values in self._pairs(of_key):
            np.copyto(kept, values)

    def _pairs(
        self, values_of: Callable[[_Key, slice], np.ndarray]
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Views of the columns in use, here and as given."""
        for key, parts in self._parts.items():
            for part in parts:
                yield self._kept[key][..., part], values_of(key, part)

    def _now(self, key: _Key, part: slice) -> np.ndarray:
        """Columns of a field's current values, (num_envs, columns), live."""
        live, _ = self._live_field(key)
        return live.reshape(len(live), -1)[:, part]

    @property
    def fields(self) -> list[str]:
        """The fields of the data that are recorded."""
        return list(dict.fromkeys(name for read, name in self._kept if read != _MODEL))

    @property
    def model(self) -> Any:  # Any: a `wrapper.MjModel`, or a model of rows
        """The model that the simulations have in common."""
        return self._simulation.model

    def data_field(self, name: str) -> _Field:
        """A field of the data, one row per simulation and step."""
        return self._field((_DATA, name))

    def model_field(self, name: str) -> _Field:
        """A field of the model, and whether each row has values of its own."""
        return self._field((_MODEL, name))

    def read_by(self, physics: _Physics) -> _Physics:
        """The batch's physics evaluated on the recorded states.

        Of a field that it reads by names, only the columns that it reads are recorded.
        """

        return self._read_through(physics, self, self.field_by_names)

    def last_read_by(self, physics: _Physics) -> _Physics:
        """The batch's physics evaluated on the states of the last step."""
        last = _Last(self)
        return self._read_through(physics, last, lambda name: last.of(self.field_by_names(name)))

    def _read_through(
        self,
        physics: _Physics,
        fields: "History | _Last",
        by_names: Callable[[str], _Field],
    ) -> _Physics:
        seen, names = physics.seen_through(fields), Names(self.model.structure)
        seen.named = NamedIndexStructs(
            NamedFields("MjModel", fields.model_field, names),
            NamedFields("MjData", by_names, names, self._indexer),
        )
        return seen

    def field_by_names(self, name: str) -> _Field:
        """A field of the data whose columns are recorded as they are read."""
        return self._field((_BY_NAMES, name))

    def _live_field(self, key: _Key) -> _Field:
        read, name = key
        if read == _MODEL:
            return self._simulation.model_field(name)
        return self._simulation.data_field(name)

    def _field(self, key: _Key) -> _Field:
        live, has_rows = self._live_field(key)
        if not has_rows:
            return live, False
        if key not in self._kept:
            # Until it is recorded the current values stand for all steps.
            rows = live.reshape(len(live), -1)
            self._kept[key] = np.repeat(rows[None], self._steps, axis=0)
            self._wanted[key] = np.zeros(rows.shape[1], bool)
            self.is_complete = False
        if live.ndim == 1 or key[0] != _BY_NAMES:
            self.want(key, slice(None))
        return self._kept[key].reshape(self._steps * len(live), *live.shape[1:]), True

    def want(self, key: _Key, columns: np.ndarray | slice) -> None:
        """Adds columns of a field to the record."""
        wanted = self._wanted[key]
        if not wanted[columns].all():
            self.is_complete = False
            wanted[columns] = True
            self._parts[key] = _parts_of(wanted)

    def _indexer(self, name: str, field: np.ndarray, axes: Axes, batch: bool) -> FieldIndexer:
        return _Recorded(self, (_BY_NAMES, name), field, axes)

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(
            f"recorded states have no {name!r}: they can be read, not stepped or changed"
        )


class _Last:
    """The fields of a record's last step."""

    def __init__(self, history: History) -> None:
        self._history = history
        self.num_envs: int | None = history.num_last

    @property
    def model(self) -> Any:  # as of a record
        """The model that the simulations have in common."""
        return self._history.model

    def of(self, field: _Field) -> _Field:
        """The last step's part of a field of all steps."""
        array, has_rows = field
        return (array[-(self.num_envs or 1) :] if has_rows else array), has_rows

    def data_field(self, name: str) -> _Field:
        """A field of the data, one row per simulation."""
        return self.of(self._history.data_field(name))

    def model_field(self, name: str) -> _Field:
        """A field of the model, and whether each row has values of its own."""
        return self.of(self._history.model_field(name))

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(
            f"recorded states have no {name!r}: they can be read, not stepped or changed"
        )


class _Recorded(FieldIndexer):
    """The index of a recorded field: what it reads by names is recorded from then on."""

    __slots__ = ("_history", "_key")

    def __init__(self, history: History, key: _Key, field: np.ndarray, axes: Axes) -> None:
        super().__init__(key[1], field, axes, batch=True)
        self._history, self._key = history, key

    def _resolve(self, key: object) -> tuple[np.ndarray, Any]:  # Any: what NumPy indexes with
        array, index = super()._resolve(key)
        numbers = np.arange(array[0].size).reshape(array.shape[1:])
        self._history.want(self._key, numbers[None][index].ravel())
        return array, index

    def __getattr__(self, name: str) -> Any:  # attributes of the array
        self._history.want(self._key, slice(None))
        return getattr(self._field, name)

    def __array__(
        self, dtype: type | np.dtype | None = None, copy: bool | None = None
    ) -> np.ndarray:
        self._history.want(self._key, slice(None))
        return super().__array__(dtype, copy)


def _parts_of(wanted: np.ndarray) -> list[slice]:
    """The parts of a row in which columns are wanted, (columns,) booleans."""
    columns = np.flatnonzero(wanted)
    # Parts that are nearer to each other are copied sooner as one than as two.
    ends = np.flatnonzero(np.diff(columns) > 8)
    starts, stops = columns[np.append(0, ends + 1)], columns[np.append(ends, -1)] + 1
    return list(map(slice, starts.tolist(), stops.tolist()))
