"""`Starts`: starts of episodes, drawn by MuJoCo in C and written as rows of float32 numbers.

    starts = Starts(environment, data_fields=("sensordata",), model_fields=("body_pos",))
    rows = starts.draw([0, 1, 2])       # (3, starts.width): the first episodes of these seeds
    for part in starts.parts:
        print(part.name, rows[:, part.columns].reshape(3, *part.shape))

A start is drawn by the task's own `initialize_episode`, in double precision, so that a task's rules
for rejecting starts hold. It has the state, the poses of geoms that never move, quantities that
belong to the last time step, and model fields that differ between episodes.
"""

import copy
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.control import Environment

__all__ = ["STATE_FIELDS", "Part", "Starts"]

# Fields of MjData that a time step depends on, in no particular order.
STATE_FIELDS = (
    *("time", "qpos", "qvel", "act", "history", "plastic", "qacc_warmstart", "ctrl"),
    *("qfrc_applied", "xfrc_applied", "eq_active", "mocap_pos", "mocap_quat", "userdata"),
)
_STATIC_FIELDS = ("geom_xpos", "geom_xmat")  # MuJoCo Warp computes those of static geoms once
_AT_ONCE = 64  # starts that are drawn together


class Part(NamedTuple):
    """A field's columns in a row of numbers.

    Attributes:
      name: the field's name.
      kind: 'state', if a time step depends on it; 'static', a pose that never changes; 'late', a
        quantity of the last time step; or 'model', a field of the model.
      columns: its columns.
      shape: its shape for one row.
    """

    name: str
    kind: str
    columns: slice
    shape: tuple[int, ...]


class Starts:
    """See the module's docstring.

    Attributes:
      parts: the fields of a row, state first.
      width: columns of a row.
      batch: the batch on the CPU in which starts are drawn.
    """

    def __init__(
        self, environment: Environment, data_fields: Sequence[str], model_fields: Sequence[str]
    ) -> None:
        """Makes a batch of environments like this one, which is not changed.

        Args:
          environment: a single environment.
          data_fields: fields of MjData besides the state.
          model_fields: fields of MjModel.

        Raises:
          ValueError: see `BatchEnvironment.from_environment`.
        """
        self.batch = BatchEnvironment.from_environment(environment, _AT_ONCE, 1, seed=0)
        self._simulation = self.batch.physics.simulation
        kinds = {
            "state": STATE_FIELDS,
            "static": _STATIC_FIELDS if model_fields else (),  # else they are the same in all rows
            "late": data_fields,
            "model": model_fields,
        }
        named = [(kind, name) for kind, names in kinds.items() for name in names]
        self.parts = tuple(self._laid_out(named))
        self.width = self.parts[-1].columns.stop

    def draw(self, seeds: Sequence[int]) -> np.ndarray:
        """The start of the first episode of each seed, (n, width) float32."""
        rows = np.empty((len(seeds), self.width), np.float32)
        for first in range(0, len(seeds), _AT_ONCE):
            some = list(seeds[first : first + _AT_ONCE])
            numbers = np.arange(len(some))
            self.batch.reset(numbers, some)
            for part in self.parts:
                values = self._field(part.kind, part.name)[: len(some)]
                rows[first : first + len(some), part.columns] = values.reshape(len(some), -1)
        return rows

    def default(self) -> np.ndarray:
        """The row of the model's default state, (width,); other columns are 0."""
        simulation = copy.deepcopy(self.batch.single).simulation
        simulation.reset()
        row = np.zeros(self.width, np.float32)
        for part in self.parts:
            if part.kind == "state":
                row[part.columns] = np.ravel(simulation.data_field(part.name)[0])
        return row

    def of_rows(self, rows: np.ndarray) -> Mapping[str, np.ndarray]:
        """Fields by name, (n, ...) each in double precision, of rows of numbers."""
        return {
            part.name: rows[:, part.columns].astype(float).reshape(-1, *part.shape)
            for part in self.parts
        }

    def close(self) -> None:
        """Frees the batch."""
        self.batch.close()

    def _field(self, kind: str, name: str) -> np.ndarray:
        """Values of all rows of the batch."""
        own = self._simulation.own_fields
        if kind == "model" and name in own:  # options too
            return np.asarray(own[name][:])
        read = self._simulation.model_field if kind == "model" else self._simulation.data_field
        return np.asarray(read(name)[0])

    def _laid_out(self, named: Sequence[tuple[str, str]]) -> list[Part]:
        parts, start = [], 0
        for kind, name in named:
            shape = self._field(kind, name).shape[1:]
            stop = start + math.prod(shape)
            if stop > start:
                parts.append(Part(name, kind, slice(start, stop), shape))
            start = stop
        return parts
