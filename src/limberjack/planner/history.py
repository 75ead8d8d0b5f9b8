"""`History`: a record of a batch's simulations at several steps, read as one batch.

    history = History(rollouts.simulation, steps=25)
    seen = rollouts.physics.seen_through(history)  # the same kind of Physics, to be read only
    for step in range(25):
        rollouts.step(2)
        history.record(step)
    seen.named.data.xpos["head", "z"]  # (25 * num_envs,), the first step's first

Quantities of all steps cost hardly more time than those of one, most of which is Python's. Only
fields that are read are recorded, and of those that are read by names only the columns in use. They
are known after the first reading:

    history.is_complete  # False: a field was read that was not recorded; from now on it is
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from limberjack.mujoco.batch_simulation import BatchSimulation
from limberjack.mujoco.index import Axes, FieldIndexer

__all__ = ["History"]

_Field = tuple[np.ndarray, bool]  # and whether each simulation has values of its own
_Key = tuple[str, str]  # what reads a field, and its name
_Parts = tuple[slice, ...]  # of a row's columns
_WHOLE: _Parts = (slice(None),)


class History:
    """See the module's docstring."""

    def __init__(self, simulation: BatchSimulation, steps: int) -> None:
        """Creates a record of a batch; nothing is recorded yet."""
        self._simulation = simulation
        self._steps = steps
        self._kept: dict[_Key, np.ndarray] = {}  # (steps, num_envs, ...) each
        self._parts: dict[_Key, _Parts] = {}  # of their rows that are kept
        # Those parts, here and in the batch, as (..., num_envs, columns), once they are recorded.
        self._live: list[tuple[np.ndarray, np.ndarray]] | None = None
        self.is_complete = True  # whether all fields read since `begin` had been recorded
        self.num_envs: int | None = steps * (simulation.num_envs or 1)  # of the recorded batch
        self._seen: set[tuple[str, bytes]] = set()  # fields and columns that were read by names
        self.begin()

    def begin(self) -> None:
        """Begins a new record."""
        self.is_complete = True
        self._live = None

    def record(self, step: int) -> None:
        """Records the batch's current quantities as those of a step, from 0 on."""
        if self._live is None:
            self._live = []
            for key, kept in self._kept.items():
                live = self._in_parts(key, self._now(key), 1)
                self._live += zip(self._in_parts(key, kept, 2), live, strict=True)
        for kept, live in self._live:
            kept[step] = live

    def _now(self, key: _Key) -> np.ndarray:
        """The batch's current values, (num_envs, ...), live."""
        return getattr(self._simulation, key[0])(key[1])[0]

    @property
    def fields(self) -> list[str]:
        """The fields of the data that are recorded."""
        return list(dict.fromkeys(n for read, n in self._kept if read != "model_field"))

    def record_all(self, values_of: Callable[[str, slice], np.ndarray]) -> None:
        """Records all steps; `values_of` gives columns of a field, (steps, num_envs, columns)."""
        for key, kept in self._kept.items():
            if key[0] == "model_field":
                kept[...] = self._now(key)
                continue
            # A matrix has a column for each of its elements.
            columns = kept.reshape(*kept.shape[:2], -1)
            for part in self._parts[key]:
                np.copyto(columns[..., part], values_of(key[1], part))

    def _in_parts(self, key: _Key, values: np.ndarray, axes: int) -> list[np.ndarray]:
        """Views of the recorded columns of a field's values, behind so many axes."""
        parts = self._parts[key]
        if parts == _WHOLE:
            return [values]
        columns = values.reshape(*values.shape[:axes], -1)
        return [columns[..., part] for part in parts]

    @property
    def model(self) -> Any:
        """The model that the simulations have in common."""
        return self._simulation.model

    def data_field(self, name: str) -> _Field:
        """A field of the data, one row per simulation and step."""
        return self._field(self._simulation.data_field, name, _WHOLE)

    def field_for_names(self, name: str) -> _Field:
        """As `data_field`; its `indexer` records what of it is read."""
        return self._field(self._simulation.field_for_names, name, ())

    def indexer(self, name: str, field: np.ndarray, axes: Axes, batch: bool) -> FieldIndexer:
        """The index of a field by names."""
        live = self._simulation.field_for_names(name)[0]
        return _Recorded(self, self._simulation.indexer(name, live, axes, True), name, field, axes)

    def want(self, name: str, columns: np.ndarray) -> None:
        """Adds columns of a field of the data to the record."""
        seen = name, columns.tobytes()
        self.is_complete &= seen in self._seen
        self._seen.add(seen)
        key = "field_for_names", name
        shape = self._kept[key].shape[2:]
        wanted = np.zeros(np.prod(shape, dtype=int), bool)
        wanted[columns] = True
        before = self._parts[key]
        if before == _WHOLE:
            return
        for part in before:
            wanted[part] = True
        self._parts[key] = _parts_of(wanted)

    def model_field(self, name: str) -> _Field:
        """A field of the model, and whether each row has values of its own."""
        return self._field(self._simulation.model_field, name, _WHOLE)

    def _field(self, read: Callable[[str], _Field], name: str, parts: _Parts) -> _Field:
        key = read.__name__, name
        if key not in self._kept:
            live, has_rows = read(name)
            if not has_rows:
                return live, False
            # Until it is recorded the current values stand for all steps.
            self._kept[key] = np.repeat(live[None], self._steps, axis=0)
            self._parts[key] = parts if live.ndim > 1 else _WHOLE
            self.is_complete = False
        kept = self._kept[key]
        return kept.reshape(-1, *kept.shape[2:]), True

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"recorded states have no {name!r}: they can be read, not stepped or changed"
        )


class _Recorded(FieldIndexer):
    """The index of a recorded field: what it reads by names is recorded from then on."""

    __slots__ = ("_history", "_live")

    def __init__(
        self, history: History, live: FieldIndexer, name: str, field: np.ndarray, axes: Axes
    ) -> None:
        super().__init__(name, field, axes, batch=True)
        self._history, self._live = history, live

    def _resolve(self, key: object) -> tuple[Any, Any]:
        array, index = super()._resolve(key)
        shape = array.shape[1:]
        numbers = np.arange(np.prod(shape, dtype=int)).reshape(shape)
        _ = self._live[key]  # so that the batch computes it
        self._history.want(self._name, numbers[None][index].ravel())
        return array, index

    def _want_all(self) -> None:
        np.asarray(self._live)
        self._history.want(self._name, np.arange(np.prod(self._field.shape[1:], dtype=int)))

    def __getattr__(self, name: str) -> Any:
        self._want_all()
        return getattr(self._field, name)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        self._want_all()
        return super().__array__(dtype, copy)


def _parts_of(wanted: np.ndarray) -> _Parts:
    """The parts of a row in which columns are wanted, (columns,) booleans."""
    columns = np.flatnonzero(wanted)
    if not columns.size:
        return ()
    # Parts that are nearer to each other are copied sooner as one than as two.
    ends = np.flatnonzero(np.diff(columns) > 8)
    starts, stops = columns[np.append(0, ends + 1)], columns[np.append(ends, -1)] + 1
    return tuple(map(slice, starts.tolist(), stops.tolist()))
