"""What a `Physics` does when it is a batch of simulations.

A batch is made of a single one by `replicate`. Its data has one row per simulation, a leading axis
that the quantities of a domain carry through to what they return.
"""

import contextlib
import weakref
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Self

import mujoco
import numpy as np

from limberjack.mujoco import fields
from limberjack.mujoco.batch_simulation import BatchData, BatchSimulation
from limberjack.mujoco.simulation import read_field
from limberjack.rl import control

__all__ = ["Rows"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value


class Rows:
    """The part of `Physics` that makes and runs batches."""

    # Any: these are `Physics`' own, and either kind of simulation.
    _data: Any
    _simulation: Any
    # A single simulation in which the rows' episodes are begun, one after the other.
    _scratch: Any = None
    # Whether constants of the model follow from the fields that are randomised.
    _constants = False

    @property
    def num_envs(self) -> int | None:
        """Number of simulations of a batch; None for a single one."""
        return self._simulation.num_envs

    @property
    def single(self) -> Any:
        """A single simulation of a batch's model, for reading specs and constants."""
        return self._scratch

    def replicate(
        self, num_envs: int, num_threads: int, episode_fields: Sequence[str] = ()
    ) -> Self:
        """A batch of simulations of this one's model, in the model's default state.

        Args:
          num_envs: number of simulations.
          num_threads: threads that step them, the caller's included.
          episode_fields: fields of the model that an episode's start may set, for its own row.
        """
        cls: Any = type(self)
        batch = cls.__new__(cls)
        vars(batch).update(
            (k, v) for k, v in vars(self).items() if k not in ("_data", "_simulation", "named")
        )
        simulation = BatchSimulation(
            self._data.model, num_envs, num_threads, episode_fields, self._constants
        )
        batch._simulation = simulation
        batch._forget_arrays()
        simulation.forget_arrays = weakref.WeakMethod(batch._forget_arrays)
        batch._scratch = cls.from_model(self._data.model.copy())
        return batch

    @contextlib.contextmanager
    def episode(self, row: int) -> Iterator[Any]:
        """Yields a single simulation, reset, whose state at exit is the start of a row's episode.

        The rows' quantities follow with `start_rows`.
        """
        one, simulation = self._scratch, self._living()
        simulation.copy_fields_out(row, one._simulation, self._constants)
        with contextlib.suppress(control.PhysicsError):
            one.reset()
        yield one
        simulation.copy_fields_in(row, one.model)
        mujoco.mj_getState(one.model._model, one.data._data, simulation.state[row], _STATE)

    def save_rows(self, rows: np.ndarray | None, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """All that the future of rows depends on; of a single simulation it is one row.

        Args:
          rows: row numbers; None for all.
          fields: fields of the model to save with the state.
        """
        return self._living().save(rows, fields)

    def load_rows(self, saved: dict[str, np.ndarray], rows: np.ndarray | None) -> None:
        """Makes rows go on as those that were saved."""
        self._living().load(saved, rows, self._constants)

    def origin(self) -> dict[str, Any]:
        """What must agree for a saved row to be loaded: MuJoCo's version and the model."""
        model = self._data.model._model
        sizes = [model.nq, model.nv, model.na, model.nu, model.nbody, model.ngeom]
        return {
            "MuJoCo": mujoco.mj_versionString(),
            "model": self._data.model.name,
            "model sizes": sizes,
            "names": zlib.crc32(model.names),
        }

    def nominal_fields(self, names: Sequence[str]) -> dict[str, np.ndarray]:
        """The model's present values of fields that are going to be randomised, by name.

        Raises:
          ValueError: there is no such field, or it is part of the model's structure.
        """
        for name in names:
            fields.check_randomizable(name)
        self._constants = fields.have_constants(names)
        return {name: np.array(read_field(self._data.model._model, name)) for name in names}

    def set_fields(self, values: dict[str, np.ndarray], row: int | None = None) -> None:
        """Sets fields of the model, and the constants that follow from them, for one row."""
        self._living().set_fields(values, row, self._constants)

    def fields_changed_by(self, start: Callable[[Any], None]) -> list[str]:
        """Fields of the model that an episode's start changes."""
        one = self._scratch
        with contextlib.suppress(control.PhysicsError):
            one.reset()
        before = one.model.copy()._model
        start(one)
        after = one.model._model
        return [
            n for n in fields.varying() if not np.array_equal(getattr(before, n), getattr(after, n))
        ]

    def start_rows(self, rows: np.ndarray) -> None:
        """Computes every quantity of rows whose episode begins, with actuation disabled."""
        self._living().forward_without_actuation(rows)

    def render_rows(self, rows: np.ndarray, fields: Sequence[str], **kwargs: Any) -> np.ndarray:
        """Pictures of rows, (n, height, width, ...); see `Physics.render` for the arguments.

        Args:
          rows: row numbers.
          fields: fields of the model that each row has for itself.
          kwargs: of `Physics.render`.
        """
        pictures = []
        for row in rows.tolist():
            self._scratch.load_rows(self.save_rows(np.array([row]), fields), None)
            pictures.append(self._scratch.render(**kwargs))
        return np.stack(pictures) if pictures else np.empty((0,))

    def step_rows(self, rows: np.ndarray | None, nstep: int) -> np.ndarray:
        """Advances rows, all for None, by `nstep` steps; returns which diverged, (num_envs,)."""
        simulation = self._living()
        simulation.batch.warning.fill(0)
        if getattr(self, "legacy_step", True):
            simulation.step(nstep, rows)
        else:
            simulation.step_whole(nstep, rows)
        if not simulation.batch.warning.any():
            return np.zeros(simulation.num_envs, bool)
        return simulation.warnings.any(axis=-1)

    def _living(self) -> Any:
        """The simulation; made anew in a forked child, where a batch's threads are not."""
        if self._simulation.is_orphan:
            self._simulation.revive()
        return self._simulation

    def _forget_arrays(self) -> None:
        """Has the fields looked up anew."""
        vars(self).pop("named", None)
        self._data = BatchData(self._simulation)
