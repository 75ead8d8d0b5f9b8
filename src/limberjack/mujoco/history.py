"""`History`: what the simulations of a batch were at several moments, to be read as one batch.

    history = History(batch, moments=25)
    seen = batch.seen_through(history)  # the same kind of Physics, to be read only
    for moment in range(25):
        batch.step_rows(None, 2)
        history.note(moment)
    seen.named.data.xpos["head", "z"]  # (25 * num_envs,), the first moment's first

Quantities of all moments cost hardly more time than those of one, most of which is Python's. Only
what is read is kept: fields, and of those that are read by names the parts of a row in which these
are. So what that is is known after the first reading:

    history.is_complete  # False: what was read was not noted; now it would be
"""

from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["History"]

_Field = tuple[np.ndarray, bool]  # and whether each simulation has values of its own
_Key = tuple[str, str]  # what reads a field, and its name
_Parts = tuple[slice, ...]  # of a row's columns
_WHOLE: _Parts = (slice(None),)
_NOTHING: _Parts = ()
_CLOSE = 8  # columns; parts that are so near to each other are copied as one, sooner than as two


class History:
    """See the module's docstring.

    Attributes:
      num_envs: of the batch that is seen through it: its own so many times as there are moments.
      is_complete: whether all that was read since `begin` had been noted.
    """

    def __init__(self, batch: Any, moments: int) -> None:
        """Makes one for a batch of `Physics`; nothing is noted yet."""
        self._simulation = batch._simulation
        self._moments = moments
        self._kept: dict[_Key, np.ndarray] = {}  # (moments, num_envs, ...) each
        self._parts: dict[_Key, _Parts] = {}  # of their rows that are kept
        # Those parts, here and in the batch, as (..., num_envs, columns), once they are noted.
        self._live: list[tuple[np.ndarray, np.ndarray]] | None = None
        self.is_complete = True
        self.num_envs = moments * batch.num_envs
        self.begin()

    def begin(self) -> None:
        """Begins anew."""
        self.is_complete = True
        self._live = None

    def note(self, moment: int) -> None:
        """Notes the batch's present quantities as those of a moment, from 0 on."""
        if self._live is None:
            self._live = []
            for key, kept in self._kept.items():
                live = self._in_parts(key, self._now(key), 1)
                self._live += zip(self._in_parts(key, kept, 2), live, strict=True)
        for kept, live in self._live:
            kept[moment] = live

    def _now(self, key: _Key) -> np.ndarray:
        """What the batch's present values are, (num_envs, ...), live."""
        return getattr(self._simulation, key[0])(key[1])[0]

    @property
    def fields(self) -> list[str]:
        """The fields of the data that are noted."""
        return list(dict.fromkeys(n for read, n in self._kept if read != "model_field"))

    def note_all(self, values_of: Callable[[str, slice], np.ndarray]) -> None:
        """Notes all moments at once.

        Args:
          values_of: gives columns of a field of the data, (moments, num_envs, columns).
        """
        for key, kept in self._kept.items():
            if key[0] == "model_field":
                kept[...] = self._now(key)
                continue
            # A matrix has a column for each of its elements.
            columns = kept.reshape(*kept.shape[:2], -1)
            for part in self._parts[key]:
                np.copyto(columns[..., part], values_of(key[1], part))

    def _in_parts(self, key: _Key, values: np.ndarray, axes: int) -> list[np.ndarray]:
        """Views of what is kept of a field's values, behind so many axes."""
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
        """A field of the data, one row per simulation and moment."""
        return self._field(self._simulation.data_field, name, _WHOLE)

    def field_for_names(self, name: str) -> _Field:
        """As `data_field`, for who says with `want` what of it is read."""
        return self._field(self._simulation.field_for_names, name, _NOTHING)

    def is_watched(self, name: str) -> bool:
        """Whether `want` is to be told what of a field is read: always."""
        return True

    def want(self, name: str, columns: Any) -> bool:
        """Has some columns of a field's rows noted; whether they were not till now.

        Args:
          name: of a field of the data.
          columns: an index for them.
        """
        if self._simulation.is_watched(name):
            self.is_complete &= not self._simulation.want(name, columns)
        key = "field_for_names", name
        shape = self._kept[key].shape[2:]
        wanted = np.zeros(np.prod(shape, dtype=int), bool)
        wanted[columns] = True
        before = self._parts[key]
        if before == _WHOLE:
            return False
        for part in before:
            wanted[part] = True
        self._parts[key] = parts = _parts_of(wanted)
        self.is_complete &= parts == before
        return parts != before

    def model_field(self, name: str) -> _Field:
        """A field of the model, and whether each row has values of its own."""
        return self._field(self._simulation.model_field, name, _WHOLE)

    def _field(self, read: Callable[[str], _Field], name: str, parts: _Parts) -> _Field:
        key = read.__name__, name
        if key not in self._kept:
            live, has_rows = read(name)
            if not has_rows:
                return live, False
            # Until it is noted the present values stand for all moments.
            self._kept[key] = np.repeat(live[None], self._moments, axis=0)
            self._parts[key] = parts if live.ndim > 1 else _WHOLE
            self.is_complete = False
        kept = self._kept[key]
        return kept.reshape(self.num_envs, *kept.shape[2:]), True

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"states that were noted have no {name!r}: they can be read, not stepped or changed"
        )


def _parts_of(wanted: np.ndarray) -> _Parts:
    """The parts of a row in which columns are wanted, (columns,) booleans."""
    columns = np.flatnonzero(wanted)
    if not columns.size:
        return _NOTHING
    ends = np.flatnonzero(np.diff(columns) > _CLOSE)
    starts, stops = columns[np.append(0, ends + 1)], columns[np.append(ends, -1)] + 1
    return tuple(map(slice, starts.tolist(), stops.tolist()))
