"""What a `Physics` does when it is a batch of simulations.

A batch is made of a single one by `replicate`. Its data has one row per simulation, a leading axis
that the quantities of a domain carry through to what they return.
"""

import contextlib
import inspect
import weakref
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Self

import mujoco
import numpy as np

from limberjack.mujoco import fields
from limberjack.mujoco.batch_simulation import BatchData, BatchSimulation
from limberjack.mujoco.camera import Camera, render
from limberjack.mujoco.rendering.pictures import Style
from limberjack.mujoco.simulation import read_field
from limberjack.rl import control
from limberjack.utils.arrays import any_of
from limberjack.utils.suggest import did_you_mean

__all__ = ["Rows"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value
_SETTINGS = ("legacy_step", "copies_as_is", "_constants")
_OF_STYLE = ("overlays", "depth", "segmentation", "render_flag_overrides", "quality")
# The keyword arguments of `Physics.render`, with their defaults.
_HOW = {p.name: p.default for p in list(inspect.signature(render).parameters.values())[1:]}


class Rows:
    """The part of `Physics` that makes and runs batches."""

    # Any: these are `Physics`' own, and either kind of simulation.
    _data: Any
    _simulation: Any
    render: Any
    # A single simulation in which the rows' episodes are begun and their pictures are drawn, one
    # after the other.
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
        # A copy, which costs nothing while it is not changed: neither's changes reach the other.
        model = self._data.model.copy()
        simulation = BatchSimulation(model, num_envs, num_threads, episode_fields, self._constants)
        cls: Any = type(self)
        batch = self.seen_through(simulation)
        simulation.forget_arrays = weakref.WeakMethod(batch._forget_arrays)
        batch._scratch = cls.from_model(model.copy())
        vars(batch._scratch).update(self._settings())
        return batch

    def seen_through(self, simulation: Any) -> Self:
        """The same quantities, of a batch's fields: a `BatchSimulation` or a `History`."""
        cls: Any = type(self)
        batch = cls.__new__(cls)
        vars(batch).update(
            (k, v) for k, v in vars(self).items() if k not in ("_data", "_simulation", "named")
        )
        batch._simulation = simulation
        batch._forget_arrays()
        return batch

    def _settings(self) -> dict[str, Any]:
        """What says how a simulation is run, which its copies have too."""
        return {name: vars(self)[name] for name in _SETTINGS if name in vars(self)}

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

    def load_everywhere(self, saved: dict[str, np.ndarray]) -> None:
        """Makes all rows of a batch go on as the only one that was saved.

        Quantities that follow from the state are those of before, till the rows are stepped.
        """
        self._living().load_everywhere(saved, self._constants)

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

    def render_rows(self, rows: np.ndarray | None, **kwargs: Any) -> np.ndarray:
        """Pictures of rows, all for None, (n, height, width, ...); a single simulation has one.

        Args:
          rows: row numbers.
          kwargs: of `Physics.render`.

        Raises:
          ValueError, TypeError: see `picture_spec`.
          RenderingError: OpenGL cannot be had.
        """
        _check_names(kwargs)
        if self.num_envs is None:
            return self.render(**kwargs)[None]
        numbers = range(self.num_envs) if rows is None else rows.tolist()
        if not numbers:
            shape, dtype = self.picture_spec(**kwargs)
            return np.empty((0, *shape), dtype)
        first = self._shown(numbers[0]).render(**kwargs)
        pictures = np.empty((len(numbers), *first.shape), first.dtype)
        pictures[0] = first
        for picture, row in zip(pictures[1:], numbers[1:], strict=True):
            picture[...] = self._shown(row).render(**kwargs)
        return pictures

    def picture_spec(self, **kwargs: Any) -> tuple[tuple[int, ...], np.dtype]:
        """Shape and type of the picture that `render` gives with these arguments; draws nothing.

        Raises:
          ValueError: there is no such camera or quality, or the size is not one that the model can
            have, or what is asked for cannot be combined.
          TypeError: there is no such keyword.
        """
        _check_names(kwargs)
        how = {**_HOW, **kwargs}
        Style.of(**{name: how[name] for name in _OF_STYLE})  # checks them
        one, size = self._scratch or self, (how["height"], how["width"])
        Camera(one, *size, camera_id=how["camera_id"], max_geom=1)  # checks them
        if how["depth"]:
            return size, np.dtype(np.float32)
        if how["segmentation"]:
            return (*size, 2), np.dtype(np.int32)
        return (*size, 3), np.dtype(np.uint8)

    def _shown(self, row: int) -> Any:
        """A single simulation with the quantities of a row, to be read before anything else."""
        one, simulation = self._scratch, self._living()
        simulation.copy_fields_out(row, one._simulation, self._constants)
        call = int(simulation._last_call[row])
        # Whole steps leave the quantities of the state before the last one.
        state = simulation._before_call[row] if call < 0 else simulation.state[row]
        mujoco.mj_setState(one.model._model, one.data._data, state, _STATE)
        if call < 0:
            one._simulation.step_whole(-call)
        elif call == 0:
            one._simulation.forward_without_actuation()
        else:
            mujoco.mj_step1(one.model._model, one.data._data)
        return one

    def step_rows(self, rows: np.ndarray | None, nstep: int) -> np.ndarray:
        """Advances rows, all for None, by `nstep` steps; returns which diverged, (num_envs,)."""
        self.forget_divergence()
        self.step_on(rows, nstep)
        return self.diverged()

    def step_on(self, rows: np.ndarray | None, nstep: int, in_passing: bool = False) -> None:
        """As `step_rows`, for who asks only after several steps which rows `diverged`.

        Args:
          rows, nstep: as there.
          in_passing: whether another step follows before anything is read that has not been read
            before; only of all rows.
        """
        simulation = self._living()
        if in_passing and getattr(self, "legacy_step", True):
            simulation.step_in_passing(nstep)
        elif getattr(self, "legacy_step", True):
            simulation.step(nstep, rows)
        else:
            simulation.step_whole(nstep, rows)

    def forget_divergence(self) -> None:
        """Begins anew to notice which rows diverge."""
        self._living().batch.warning.fill(0)

    def diverged(self) -> np.ndarray:
        """Which rows have diverged since that was forgotten, (num_envs,)."""
        simulation = self._living()
        if not any_of(simulation.batch.warning):
            return np.zeros(simulation.num_envs, bool)
        return simulation.warnings.any(axis=-1)

    def roll_out(
        self, controls: np.ndarray, fields: Sequence[str], out: dict[str, np.ndarray] | None = None
    ) -> tuple[dict[str, np.ndarray], np.ndarray]:
        """Advances all rows by time steps whose controls are known, with a record of them.

        Threads take whole rows, so that none waits for the others between steps. Afterwards all but
        the state may belong to the state before the last step.

        Args:
          controls: (num_envs, steps, nu).
          fields: of the data, to be recorded after each step.
          out: records of an earlier call of the same size, to be written over.

        Returns:
          The records by field, (num_envs, steps, ...) each, and which rows diverged, (num_envs,):
          those stop, and their last record is repeated.

        Raises:
          ValueError: a field cannot be recorded.
        """
        self.forget_divergence()
        records = self._living().roll_out(controls, fields, out)
        return records, self.diverged()

    def _living(self) -> Any:
        """The simulation; made anew in a forked child, where a batch's threads are not."""
        if self._simulation.is_orphan:
            self._simulation.revive()
        return self._simulation

    def _forget_arrays(self) -> None:
        """Has the fields looked up anew."""
        vars(self).pop("named", None)
        self._data = BatchData(self._simulation)


def _check_names(given: dict[str, Any]) -> None:
    """Raises TypeError if `Physics.render` does not take a keyword."""
    for name in given:
        if name not in _HOW:
            raise TypeError(
                f"render got an unexpected keyword argument {name!r}.{did_you_mean(name, _HOW)} "
                f"It takes: {', '.join(_HOW)}."
            )
