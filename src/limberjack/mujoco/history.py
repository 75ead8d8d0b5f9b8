"""`History`: what the simulations of a batch were at several moments, to be read as one batch.

    history = History(batch, moments=25)
    seen = batch.seen_through(history)  # the same kind of Physics, to be read only
    for moment in range(25):
        batch.step_rows(None, 2)
        history.note(moment)
    seen.named.data.xpos["head", "z"]  # (25 * num_envs,), the first moment's first

Quantities of all moments cost hardly more time than those of one, most of which is Python's. Only
fields that are read are kept, so that which ones these are is known after the first reading:

    history.is_complete  # False: what was read was not noted; now it would be
"""

from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["History"]

_Field = tuple[np.ndarray, bool]  # and whether each simulation has values of its own


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
        self._kept: dict[tuple[str, str], np.ndarray] = {}  # (moments, num_envs, ...) each
        self._live: list[tuple[np.ndarray, np.ndarray]] = []
        self.is_complete = True
        self.num_envs = moments * batch.num_envs
        self.begin()

    def begin(self) -> None:
        """Begins anew: looks up where the batch's quantities are."""
        self.is_complete = True
        simulation = self._simulation
        self._live = [(kept, getattr(simulation, r)(n)[0]) for (r, n), kept in self._kept.items()]

    def note(self, moment: int) -> None:
        """Notes the batch's present quantities as those of a moment, from 0 on."""
        for kept, live in self._live:
            kept[moment] = live

    @property
    def fields(self) -> list[str]:
        """The fields of the data that are noted."""
        return list(dict.fromkeys(n for read, n in self._kept if read != "model_field"))

    def note_all(self, values_of: Callable[[str], np.ndarray]) -> None:
        """Notes all moments at once.

        Args:
          values_of: gives the values of a field of the data, (moments, num_envs, ...).
        """
        for ((read, name), kept), (_, live) in zip(self._kept.items(), self._live, strict=True):
            values = live if read == "model_field" else values_of(name)
            np.copyto(kept, values if values.ndim <= kept.ndim else values.reshape(kept.shape))

    @property
    def model(self) -> Any:
        """The model that the simulations have in common."""
        return self._simulation.model

    def data_field(self, name: str) -> _Field:
        """A field of the data, one row per simulation and moment."""
        return self._field(self._simulation.data_field, name)

    def field_for_names(self, name: str) -> _Field:
        """As `data_field`, for who says with `want` which sensors' readings are wanted."""
        return self._field(self._simulation.field_for_names, name)

    def want(self, columns: Any) -> bool:
        """As a `BatchSimulation`'s: readings that were not computed were not noted, either."""
        is_new = self._simulation.want(columns)
        self.is_complete &= not is_new
        return is_new

    def model_field(self, name: str) -> _Field:
        """A field of the model, and whether each row has values of its own."""
        return self._field(self._simulation.model_field, name)

    def _field(self, read: Callable[[str], _Field], name: str) -> _Field:
        key = read.__name__, name
        if key not in self._kept:
            live, has_rows = read(name)
            if not has_rows:
                return live, False
            # Until it is noted the present values stand for all moments.
            self._kept[key] = np.repeat(live[None], self._moments, axis=0)
            self.is_complete = False
        kept = self._kept[key]
        return kept.reshape(self.num_envs, *kept.shape[2:]), True

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"states that were noted have no {name!r}: they can be read, not stepped or changed"
        )
