"""`BatchSimulation`: many simulations of one model, stepped by a thread pool.

    simulation = BatchSimulation(model, num_envs=256, num_threads=8, own_fields=("body_pos",))
    simulation.step(5)
    heights = simulation.data_field("xpos")[0][:, 3, 2]     # (256,)

It implements `Simulation`, as `SingleSimulation` does. A field always has the values that it would
have in a single simulation. The techniques that make batches fast are all in this file, and no
other code depends on them:

- **Rows share an `MjData`.** In a large batch, all rows of a thread share one: it stays in the
  processor's caches, and memory hardly grows with the number of rows. In a small batch each row has
  its own, so that a step continues from the results of the last one.
- **Fields are bound on first use.** The values that a thread computes for a row are copied out
  before the next row overwrites them, but only for bound fields. A field bound late was not copied
  in the last call, so it is recomputed by replaying that call.
- **Calls are replayed.** Each row's last call and the state before it are recorded. Repeating the
  call reproduces every quantity bit for bit. Snapshots are restored in the same way.
- **The world body has no bounding volume tree** if contacts are the same without it: see
  `midphase`.

Data that MuJoCo keeps outside its state (plugins, sleeping islands) can be neither replayed nor
shared: for such models every row has an `MjData`. A forked child lacks the batch's threads, so the
batch is rebuilt there in its current state.
"""

import ctypes
import os
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import NoReturn, TypeVar

import mujoco
import mujoco.batch
import numpy as np

from limberjack.mujoco import midphase, row_fields
from limberjack.mujoco.allocating import allocating, data_of
from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.mujoco.model_values import derived_fields
from limberjack.mujoco.read_only import ReadOnly
from limberjack.mujoco.simulation import (
    STATE,
    Call,
    CountsWarnings,
    Field,
    Rows,
    can_be_repeated,
    checked_steps,
    is_bad_state,
    model_fields,
    read_field,
)
from limberjack.mujoco.wrapper.core import MjModel
from limberjack.mujoco.wrapper.integer_fields import check_values, is_checked, rows_field
from limberjack.mujoco.wrapper.model import fixed_field, is_structure
from limberjack.worlds.appearance.looks import Look

__all__ = ["BatchSimulation", "check_callbacks"]

_T = TypeVar("_T")
_A_FEW = 256  # rows; in larger batches sharing is mostly faster and takes a twentieth of the memory
_NOTHING = mujoco.mjtStage.mjSTAGE_NONE.value
_UP_TO_VELOCITY = mujoco.mjtStage.mjSTAGE_VEL.value
_SLEEP_OR_IPC = mujoco.mjtEnableBit.mjENBL_SLEEP.value | mujoco.mjtEnableBit.mjENBL_IPC.value
# Functions that return the installed callbacks, by the callbacks' names.
_CALLBACKS: dict[str, Callable[[], object]] = {
    name.removeprefix("get_"): getattr(mujoco, name)
    for name in dir(mujoco)
    if name.startswith("get_mjcb_")
}
_C_FUNCTION = ctypes.CFUNCTYPE(None).__bases__  # the class of all functions of ctypes
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
        self.look: Look | None = None  # rows have looks of their own: `Replicas.looks`
        self._model = model
        # Called in a forked child, where arrays returned earlier are no longer live.
        self.forget_arrays: Callable[[], Callable[[], None] | None] = lambda: None
        # MuJoCo copies the model for each batch: 12 MB with textures.
        self._light: mujoco.MjModel = model.without_textures()._official
        # Whether MuJoCo keeps more per row than its state; `reset` clears that.
        self.remembers = self._light.nplugin > 0 or bool(
            self._light.opt.enableflags & _SLEEP_OR_IPC
        )
        self._shares = num_envs > _A_FEW and not self.remembers
        self._was_called = False
        self.num_calls = 0  # that advanced or computed, not repeated ones
        size = num_envs * mujoco.mj_stateSize(self._light, STATE) * np.dtype(float).itemsize
        with allocating(f"a batch of {num_envs} simulations", size):
            self._make(num_envs, own_fields)
            # The last call of each row, its count, and the state before it.
            self._calls = np.full(num_envs, Call.LOAD)
            self._counts = np.ones(num_envs, int)
            self._before = self._state.copy()
        _alive.add(self)

    def _make(self, num_envs: int, own_fields: Sequence[str]) -> None:
        """Makes the official batch in the model's default state."""
        self._is_orphan = False
        self._official = mujoco.batch.Batch(
            self._light, num_envs, self.num_threads, persistent=not self._shares
        )
        self._state: np.ndarray = self._official.state
        # MuJoCo's warnings by type: last info and count, (num_envs, 7, 2).
        self._warning: np.ndarray = self._official.warning
        self.warnings = self._warning[..., 1]
        self._no_warnings = bytes(self.warnings.nbytes)
        self._fields = row_fields.of(self._official, self._light, num_envs, own_fields)
        self._is_without_actuation = False  # True after Ctrl-C in the middle of a start
        if midphase.is_needless(self._light, self._fields.own):
            self._fields.write("body_bvhadr", 0, -1)  # no tree for the world body
        self._bound: set[str] = set()
        self.ctrl = self._bound_field("ctrl")

    # Reading.

    @property
    def model(self) -> MjModel:
        """The model shared by the simulations."""
        return self._model

    @property
    def state(self) -> np.ndarray:
        """Integration state, (num_envs, nstate), live."""
        self._adopt()
        return self._state

    @property
    def computed_from(self) -> np.ndarray:
        """The state from which each row's positions and velocities were computed, a copy."""
        is_stepped = np.isin(self._calls, (Call.STEP, Call.STEP_WHOLE))
        return np.where(is_stepped[:, None], self.state, self._before)

    @property
    def own_fields(self) -> Mapping[str, row_fields.OwnField]:
        """Per-row model fields by name, indexed by row, live; see `row_fields`."""
        self._adopt()
        return self._fields.own

    def data_field(self, name: str) -> Field:
        """See `Fields`."""
        self._adopt()
        return self._bound_field(name), True

    def _bound_field(self, name: str) -> np.ndarray:
        """A field of the data, which calls copy out from now on."""
        field = getattr(self._official, name)
        if name not in self._bound and isinstance(field, np.ndarray) and field.base is not None:
            if self._shares and self._was_called and not field.flags.writeable:
                self._replay()
            self._bound.add(name)
        return field

    def model_field(self, name: str) -> Field:
        """See `Fields`."""
        own = self.own_fields
        model = self._model._official
        if name in own:
            rows = self._fields.shown(name)
            is_open = is_structure(name) and rows.flags.writeable
            return (rows_field(model, name, rows) if is_open else rows), True
        if is_checked(name):
            return ReadOnly.of(getattr(model, name), _BEFORE.format(name)), False
        if is_structure(name):
            return fixed_field(model, name), False
        if self.sets_constants and name in derived_fields(own):
            return ReadOnly.of(self._official.expand(name), _DERIVED.format(name)), True
        field = getattr(model, name)
        is_array = isinstance(field, np.ndarray)
        return ReadOnly.of(field, _COMMON.format(name)) if is_array else field, False

    # Stepping.

    def step(self, nstep: int, rows: Rows = None) -> None:
        """See `Simulation`."""
        check_callbacks()
        self.advance(Call.STEP, checked_steps(nstep), rows)

    def step_whole(self, nstep: int, rows: Rows = None) -> None:
        """See `Simulation`."""
        check_callbacks()
        self.advance(Call.STEP_WHOLE, checked_steps(nstep), rows)

    def forward(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        check_callbacks()
        self.advance(Call.FORWARD, 1, rows)

    def forward_without_actuation(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        check_callbacks()
        self.advance(Call.START, 1, rows)

    def advance(self, call: Call, count: int, rows: Rows) -> None:
        """Makes a call and records it; both the callbacks and the count were checked.

        Args:
          call: the kind of the call.
          count: its number of time steps; 1 for a call that takes none.
          rows: sorted row numbers, None for all.
        """
        self._adopt()
        self.num_calls += 1
        if rows is None:
            np.copyto(self._before, self._state)
            self._calls.fill(call)
            self._counts.fill(count)
        else:
            self._before[rows] = self._state[rows]
            self._calls[rows], self._counts[rows] = call, count
        self._was_called = True
        pass_exit_guard()
        if self._is_without_actuation:
            self._restore_actuation()
        if call is Call.STEP:
            self._official.step(rows, count, _UP_TO_VELOCITY)
        elif call is Call.STEP_WHOLE:
            self._official.step(rows, count)
        elif call is Call.FORWARD:
            self._official.forward(rows)
        elif call is Call.START:
            self._is_without_actuation = True
            try:
                self._fields.disable_actuation(rows)
                self._official.forward(rows)
            finally:
                self._restore_actuation()
        else:
            self._official.forward(rows, _UP_TO_VELOCITY)

    def _restore_actuation(self) -> None:
        self._fields.restore_actuation()
        self._is_without_actuation = False

    def _replay(self) -> None:
        """Repeats the last calls to write all bound fields; changes nothing else."""
        num_calls = self.num_calls
        kept = [(live, live.copy()) for live in (self._state, self._warning)]
        readings = self._official.sensordata.copy() if "sensordata" in self._bound else None
        np.copyto(self._state, self._before)
        try:
            self._advance_each(self._calls, self._counts, np.arange(len(self._calls)))
        finally:
            self.num_calls = num_calls
            for live, values in kept:
                np.copyto(live, values)
        if readings is not None:
            loaded = self._calls == Call.LOAD
            self._set_readings(loaded, readings[loaded])

    def _advance_each(self, calls: np.ndarray, counts: np.ndarray, rows: np.ndarray) -> None:
        """Makes calls, (n,) with their counts, in rows (n,)."""
        for call, count in np.unique(np.stack([calls, counts], -1), axis=0).tolist():
            self.advance(Call(call), count, rows[(calls == call) & (counts == count)])

    def reset(self, keyframe: int | None = None, rows: Rows = None) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        check_callbacks()
        self._adopt()
        key = -1 if keyframe is None else keyframe
        self._official.reset(rows, key, stage=_NOTHING)

    def call_directly(self, call: Callable[[mujoco.batch.Batch], _T]) -> _T:
        """The result of `call`, which receives the `mujoco.batch.Batch` and may advance all rows.

        Quantities that depend on accelerations are unavailable afterwards.
        """
        pass_exit_guard()
        self._adopt()
        try:
            return call(self._official)
        finally:  # what led to the state is unknown
            self._was_called = True
            self._calls[:] = Call.LOAD
            self._before[...] = self._state

    # Writing.

    def get_state(self, signature: int) -> np.ndarray:
        """See `Simulation`."""
        pass_exit_guard()
        model, state = self._model._official, self.state
        parts = np.empty((len(state), mujoco.mj_stateSize(model, signature)))
        for whole, part in zip(state, parts, strict=True):
            mujoco.mj_extractState(model, whole, STATE, part, signature)
        return parts

    def set_state(self, state: np.ndarray, signature: int) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        data = data_of(self._model._official)
        for row, part in zip(self.state, state, strict=True):
            mujoco.mj_setState(self._model._official, data, row, STATE)
            mujoco.mj_setState(self._model._official, data, part, signature)
            mujoco.mj_getState(self._model._official, data, row, STATE)

    def set_fields(self, values: Mapping[str, np.ndarray], row: int | None = None) -> None:
        """See `Simulation`."""
        own = self.own_fields
        index = slice(None) if row is None else row
        _check_rows(self._model._official, values, len(self._state) if row is None else 1)
        for name, value in values.items():
            own[name][index] = value
        self.set_constants(None if row is None else np.array([row]))

    def set_constants(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        if self.sets_constants:
            pass_exit_guard()
            self._adopt()
            self._fields.set_const(rows)

    # Saving and loading.

    def save(self, rows: Rows, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """See `Simulation`."""
        index = slice(None) if rows is None else rows
        saved = {"state": self.state, "sensordata": self._bound_field("sensordata")}
        saved |= self._recorded()
        own = {name: np.array(self._fields.own[name][index]) for name in fields}
        return {name: np.array(values[index]) for name, values in saved.items()} | own

    def _recorded(self) -> dict[str, np.ndarray]:
        return {"before": self._before, "call": self._calls, "count": self._counts}

    def seen(self, row: int) -> dict[str, np.ndarray]:
        """Data that, once loaded, gives a single simulation the row's positions and velocities."""
        saved = {"state": self.state}
        if self._calls[row] != Call.STEP:  # else they belong to the state after the call
            saved |= self._recorded()
        return {name: values[row, None] for name, values in saved.items()}

    def load(self, saved: Mapping[str, np.ndarray], rows: Rows = None) -> None:
        """See `Simulation`. States that MuJoCo would reject diverge at the next step."""
        pass_exit_guard()
        check_callbacks()
        own = self.own_fields
        rows = np.arange(len(self._state)) if rows is None else rows
        _check_rows(self._model._official, model_fields(saved), len(rows))
        for name, value in model_fields(saved).items():
            own[name][rows] = value
        self.set_constants(rows)
        self._bound_field("sensordata")
        if self.remembers:  # such as which bodies have been at rest, and for how long
            self._official.reset(rows, stage=_NOTHING)
        counted = self._warning.copy()
        is_reached = self._repeat(saved, rows) if "call" in saved else np.zeros(len(rows), bool)
        left, state = rows[~is_reached], saved["state"][~is_reached]
        if left.size:
            self._state[left] = self._before[left] = state
            self._calls[left] = Call.LOAD
            # Here MuJoCo would silently replace a bad state by the default pose. The next step
            # replaces it with a warning.
            is_good = ~is_bad_state(self._light, state)
            if is_good.any():
                self.advance(Call.LOAD, 1, left[is_good])
            if "sensordata" in saved:
                self._set_readings(left, saved["sensordata"][~is_reached])
        np.copyto(self._warning, counted)

    def _repeat(self, saved: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """Repeats the saved calls; returns which rows reach the saved states, (n,) booleans.

        A row misses its saved state if the state or the model was changed after that call.
        """
        calls, counts, state = saved["call"], saved["count"], saved["state"]
        self._state[rows] = saved["before"]
        can_be = can_be_repeated(calls, counts) & ~is_bad_state(self._light, state)
        can_be &= not self.remembers
        self._advance_each(calls[can_be], counts[can_be], rows[can_be])
        reached = self._state[rows]
        same = reached.view(np.uint64) == np.ascontiguousarray(state).view(np.uint64)
        return can_be & same.all(axis=-1)

    def _set_readings(self, rows: np.ndarray | slice, values: np.ndarray) -> None:
        """Sets sensor readings, which a loaded state keeps from the time step before it."""
        readings = self._official.sensordata
        readings.flags.writeable = True  # read-only for users, as an output
        readings[rows] = values
        readings.flags.writeable = False

    # Forked children.

    def abandon(self) -> None:
        """Marks the batch as unusable in a forked child, which lacks the batch's threads."""
        self._is_orphan = True
        # Never freed: its destructor would wait for threads that do not exist here.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self._official._b))
        forget = self.forget_arrays()
        if forget is not None:
            forget()

    def _adopt(self) -> None:
        """Makes the official batch again in its current state, on first use in a forked child."""
        if not self._is_orphan:
            return
        state, own = self._state, self._fields.own
        readings = self._official.sensordata if "sensordata" in self._bound else None
        self._make(len(state), tuple(own))
        for name, values in own.items():
            self._fields.own[name][...] = values[:]
        if self.sets_constants:
            self._fields.set_const(None)
        self._state[...] = state
        if readings is not None:
            self._bound_field("sensordata")
        self._replay()
        if readings is not None:
            self._set_readings(slice(None), readings)

    def __getattr__(self, name: str) -> NoReturn:
        raise AttributeError(f"a batch of simulations has no {name!r}")


def check_callbacks() -> None:
    """Raises ValueError if a MuJoCo callback is a Python function, with which no batch runs.

    MuJoCo would raise too, but in the middle of a call.
    """
    for name, get in _CALLBACKS.items():
        installed = get()
        if installed is None:
            continue
        if callable(installed) and not isinstance(installed, _C_FUNCTION):
            raise ValueError(
                f"{name} is a Python function, {installed!r}, and a batch runs only C callbacks: "
                f"remove it with mujoco.set_{name}(None), or install a function compiled in C "
                "through ctypes; nothing was stepped"
            )


def _check_rows(model: mujoco.MjModel, values: Mapping[str, np.ndarray], count: int) -> None:
    """Raises ValueError if a row's values of the model's fields make its model invalid.

    Args:
      model: the model that the rows share.
      values: by name, one for each row or for all.
      count: number of rows.
    """
    if not any(map(is_checked, values)):
        return
    shapes = {name: (count, *np.shape(read_field(model, name))) for name in values}
    each = {name: np.broadcast_to(value, shapes[name]) for name, value in values.items()}
    for row in range(count):
        check_values(model, {name: array[row] for name, array in each.items()})


# Batches to abandon in a forked child, which lacks their threads.
_alive: "weakref.WeakSet[BatchSimulation]" = weakref.WeakSet()


def _abandon_all() -> None:
    for simulation in list(_alive):
        simulation.abandon()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_abandon_all)
