"""`BatchSimulation`: many simulations of one model, stepped by a thread pool.

    simulation = BatchSimulation(model, num_envs=256, num_threads=8, own_fields=("body_pos",))
    simulation.step(5)
    heights = simulation.data_field("xpos")[0][:, 3, 2]     # (256,)

It implements `Simulation`, as `SingleSimulation` does; the optimisations are in `lazy_batch`. A
forked child lacks the batch's threads, so the batch is rebuilt there in its current state.
"""

import ctypes
import os
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import NoReturn, TypeVar

import mujoco
import mujoco.batch
import numpy as np

from limberjack.mujoco.allocating import allocating, data_of
from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.mujoco.index import Axes, FieldIndexer
from limberjack.mujoco.lazy_batch import LazyBatch, check_callbacks
from limberjack.mujoco.model_values import derived_fields
from limberjack.mujoco.read_only import ReadOnly
from limberjack.mujoco.simulation import (
    FORWARD,
    NOT_FIELDS,
    START,
    STATE,
    CountsWarnings,
    Field,
    Rows,
    checked_steps,
    read_field,
)
from limberjack.mujoco.wrapper.core import MjModel
from limberjack.mujoco.wrapper.integer_fields import check_values, is_checked, rows_field
from limberjack.mujoco.wrapper.model import fixed_field, is_structure
from limberjack.utils.arrays import AnyArray

__all__ = ["BatchSimulation"]

_T = TypeVar("_T")
_NOTHING = mujoco.mjtStage.mjSTAGE_NONE.value
_COMMON = (
    "{} of the model is shared by all rows and read-only: to vary it from row to row, give "
    "environment_kwargs={{'randomize': ...}}, or name it in the task's EPISODE_FIELDS"
)
_BEFORE = (
    "{} of the model is shared by all rows and read-only: change the model of a single environment "
    "and create the batch from that"
)
_DERIVED = "{} of the model is read-only: MuJoCo computes it from fields that differ by row"


class BatchSimulation(CountsWarnings):
    """Many simulations; see `limberjack.mujoco.simulation.Simulation`."""

    def __init__(
        self, model: MjModel, num_envs: int, num_threads: int, own_fields: Sequence[str]
    ) -> None:
        """Makes simulations in the model's default state.

        Args:
          model: the shared model.
          num_envs: number of simulations.
          num_threads: number of threads, the caller's included.
          own_fields: model fields of which each simulation has its own copy.

        Raises:
          MemoryError: there is no memory for them.
        """
        self.num_envs: int | None = num_envs
        self.num_threads = num_threads
        self.sets_constants = False
        self._model = model
        # Called in a forked child, where arrays returned earlier are no longer live.
        self.forget_arrays: Callable[[], Callable[[], None] | None] = lambda: None
        # MuJoCo copies the model for each batch: 12 MB with textures.
        light = model.without_textures()._model
        size = num_envs * mujoco.mj_stateSize(light, STATE) * np.dtype(float).itemsize
        with allocating(f"a batch of {num_envs} simulations", size):
            self._use(LazyBatch(light, num_envs, num_threads, own_fields))
        _alive.add(self)

    def _use(self, lazy: LazyBatch) -> None:
        self._lazy = lazy
        self._is_orphan = False
        self.ctrl = lazy.field("ctrl")
        self.warnings = lazy.warning[..., 1]
        self._no_warnings = bytes(self.warnings.nbytes)

    @property
    def model(self) -> MjModel:
        """The model shared by the simulations."""
        return self._model

    @property
    def state(self) -> np.ndarray:
        """Integration state, (num_envs, nstate), live."""
        return self._living().state

    @property
    def remembers(self) -> bool:
        """Whether MuJoCo keeps more per row than its state; `reset` clears that."""
        return self._lazy.remembers

    @property
    def own_fields(self) -> Mapping[str, AnyArray]:
        """Per-row model fields by name, indexed by row, live."""
        return self._living().own

    def step(self, nstep: int, rows: Rows = None) -> None:
        """See `Simulation`."""
        self._call(checked_steps(nstep), rows)

    def step_whole(self, nstep: int, rows: Rows = None) -> None:
        """See `Simulation`."""
        self._call(-checked_steps(nstep), rows)

    def forward(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        self._call(FORWARD, rows)

    def forward_without_actuation(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        self._call(START, rows)

    def _call(self, kind: int, rows: Rows) -> None:
        self._living().call(kind, rows)

    def reset(self, keyframe: int | None = None, rows: Rows = None) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        check_callbacks()
        key = -1 if keyframe is None else keyframe
        self._living().official.reset(rows, key, stage=_NOTHING)

    def get_state(self, signature: int) -> np.ndarray:
        """See `Simulation`."""
        pass_exit_guard()
        model, state = self._model._model, self.state
        parts = np.empty((len(state), mujoco.mj_stateSize(model, signature)))
        for whole, part in zip(state, parts, strict=True):
            mujoco.mj_extractState(model, whole, STATE, part, signature)
        return parts

    def set_state(self, state: np.ndarray, signature: int) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        data = data_of(self._model._model)
        for row, part in zip(self.state, state, strict=True):
            mujoco.mj_setState(self._model._model, data, row, STATE)
            mujoco.mj_setState(self._model._model, data, part, signature)
            mujoco.mj_getState(self._model._model, data, row, STATE)

    def set_fields(self, values: Mapping[str, np.ndarray], row: int | None = None) -> None:
        """See `Simulation`."""
        lazy = self._living()
        index = slice(None) if row is None else row
        _check_rows(self._model._model, values, len(lazy.state) if row is None else 1)
        for name, value in values.items():
            lazy.own[name][index] = value
        self.set_constants(None if row is None else np.array([row]))

    def set_constants(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        if self.sets_constants:
            self._living().set_const(rows)

    def save(self, rows: Rows, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """See `Simulation`."""
        lazy = self._living()
        index = slice(None) if rows is None else rows
        return lazy.save(rows) | {name: np.array(lazy.own[name][index]) for name in fields}

    def seen(self, row: int) -> dict[str, np.ndarray]:
        """Data that, once loaded, gives a single simulation the row's positions and velocities."""
        return self._living().seen(row)

    def load(self, saved: Mapping[str, np.ndarray], rows: Rows = None) -> None:
        """See `Simulation`. States that MuJoCo would reject diverge at the next step."""
        pass_exit_guard()
        check_callbacks()
        lazy = self._living()
        index = slice(None) if rows is None else rows
        _check_rows(self._model._model, saved, len(saved["state"]))
        for name, value in saved.items():
            if name not in NOT_FIELDS:
                lazy.own[name][index] = value
        self.set_constants(rows)
        lazy.load(saved, rows)

    def call_directly(self, call: Callable[[mujoco.batch.Batch], _T]) -> _T:
        """The result of `call`, which receives the `mujoco.batch.Batch` and may advance all rows.

        Quantities that depend on accelerations are unavailable afterwards.
        """
        pass_exit_guard()
        lazy = self._living()
        try:
            return call(lazy.official)
        finally:
            lazy.forget_calls()

    def data_field(self, name: str) -> Field:
        """See `Fields`."""
        return self._living().field(name), True

    def field_for_names(self, name: str) -> Field:
        """See `Fields`."""
        return self._living().field_for_names(name), True

    def indexer(self, name: str, field: AnyArray, axes: Axes, batch: bool) -> FieldIndexer:
        """See `Fields`."""
        return self._lazy.indexer(name, field, axes, batch)

    def model_field(self, name: str) -> Field:
        """See `Fields`."""
        lazy = self._living()
        model = self._model._model
        if name in lazy.own:
            rows = lazy.shown(name)
            is_open = is_structure(name) and rows.flags.writeable
            return (rows_field(model, name, rows) if is_open else rows), True
        if is_checked(name):
            return ReadOnly.of(getattr(model, name), _BEFORE.format(name)), False
        if is_structure(name):
            return fixed_field(model, name), False
        if self.sets_constants and name in derived_fields(lazy.own):
            return ReadOnly.of(lazy.official.expand(name), _DERIVED.format(name)), True
        field = getattr(model, name)
        is_array = isinstance(field, np.ndarray)
        return ReadOnly.of(field, _COMMON.format(name)) if is_array else field, False

    def abandon(self) -> None:
        """Marks the batch as unusable in a forked child, which lacks the batch's threads."""
        self._is_orphan = True
        # Never freed: its destructor would wait for threads that do not exist here.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._lazy.official._b))
        forget = self.forget_arrays()
        if forget is not None:
            forget()

    def _living(self) -> LazyBatch:
        """The batch; rebuilt on first use in a forked child."""
        if self._is_orphan:
            self._use(self._lazy.made_again(self.sets_constants))
        return self._lazy

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"a batch of simulations has no {name!r}")


def _check_rows(model: mujoco.MjModel, values: Mapping[str, AnyArray], count: int) -> None:
    """Raises ValueError if a row's values of the model's fields make its model invalid.

    Args:
      model: the model that the rows share.
      values: by name, one for each row or for all.
      count: number of rows.
    """
    if not any(map(is_checked, values)):
        return
    names = [name for name in values if name not in NOT_FIELDS]
    shapes = {name: (count, *np.shape(read_field(model, name))) for name in names}
    each = {name: np.broadcast_to(values[name], shapes[name]) for name in names}
    for row in range(count):
        check_values(model, {name: array[row] for name, array in each.items()})


# Batches to abandon in a forked child, which lacks their threads.
_alive: "weakref.WeakSet[BatchSimulation]" = weakref.WeakSet()


def _abandon_all() -> None:
    for simulation in list(_alive):
        simulation.abandon()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_abandon_all)
