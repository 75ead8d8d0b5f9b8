"""Running many simulations of one model on a pool of threads; see `simulation.py` for one.

A few simulations have an `MjData` each, so that a step goes on from the stages that the last one
ended with. Of many, those of a thread share one: it stays in the processor's caches, and memory
hardly grows with their number. What a thread computes for a row is then copied out at once, for the
fields that somebody has asked for; a field that is asked for later is made up for by repeating each
row's last call. So are sensors, which rest until they are asked for where they may; see `sensors`.
"""

import ctypes
import os
import weakref
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import mujoco.batch
import numpy as np

from limberjack.mujoco import midphase, sensors
from limberjack.mujoco.leaving import Busy, begin, watch
from limberjack.mujoco.simulation import ACTUATION, NOT_FIELDS, SingleSimulation, read_field
from limberjack.mujoco.wrapper.core import MjModel

__all__ = ["BatchData", "BatchSimulation"]

_NOTHING, _UP_TO_VELOCITY = mujoco.mjtStage.mjSTAGE_NONE.value, mujoco.mjtStage.mjSTAGE_VEL.value
_SLEEP_OR_IPC = mujoco.mjtEnableBit.mjENBL_SLEEP.value | mujoco.mjtEnableBit.mjENBL_IPC.value
_TIME = mujoco.mjtState.mjSTATE_TIME.value
_NEVER = mujoco.mjtStage.mjSTAGE_NONE.value
_A_FEW = 128  # beyond it, sharing is as quick; it takes a twentieth of the memory
# What a row's last call was, where it was not so many steps: a negative number is whole steps.
_START, _LOAD = 0, np.iinfo(int).max


class BatchData:
    """The fields of a batch's simulations, `data.qpos` (num_envs, nq) and so on, live."""

    def __init__(self, simulation: "BatchSimulation") -> None:
        vars(self)["_simulation"] = simulation

    @property
    def _data(self) -> Any:
        """Where a single simulation's wrapper has the official data: the same fields."""
        return self

    @property
    def model(self) -> MjModel:
        """The model that the simulations have in common."""
        return self._simulation.model

    def __getattr__(self, name: str) -> Any:
        if name == "_simulation":  # a half-made object, as in copying: do not look it up for ever
            raise AttributeError(name)
        field = self._simulation.data_field(name)[0]
        if isinstance(field, np.ndarray):
            vars(self)[name] = field  # the same array as long as the simulations live
        return field

    def __setattr__(self, name: str, value: Any) -> None:
        self._simulation.data_field(name)[0][...] = value


class BatchSimulation(Busy):
    """Many simulations of one model, stepped on a pool of threads.

    `state` holds what a step depends on, (num_envs, nstate); `warnings` counts MuJoCo's warnings
    by kind, (num_envs, 7), both live; `batch` is the official batch. Rows are sorted arrays of row
    numbers, None for all.
    """

    def __init__(
        self,
        model: MjModel,
        num_envs: int,
        num_threads: int,
        episode_fields: Sequence[str],
        constants: bool,
    ) -> None:
        """Makes a batch in the model's default state.

        Args:
          model: what the simulations have in common.
          num_envs: number of simulations.
          num_threads: threads that step them.
          episode_fields: fields of the model that each row has for itself.
          constants: whether constants of the model follow from those.
        """
        self.model = model
        self._compiled = model._model
        self._constants = constants
        # Called in a forked child, where the arrays that were handed out are no longer live.
        self.forget_arrays: Callable[[], Callable[[], None] | None] = lambda: None
        self.num_envs: int | None = num_envs
        self.num_threads = num_threads
        self._fields = dict.fromkeys(episode_fields)
        self._wanted = np.zeros(self._compiled.nsensor, bool)  # sensors that somebody asked for
        self._make()
        _alive.add(self)
        watch(self)

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"a batch of simulations has no {name!r}: its BatchEnvironment steps and resets it, "
            "not its physics; the next step goes from the state that you set, without forward()"
        )

    def _make(self) -> None:
        """Makes the official batch, whose threads belong to this process."""
        model = self._compiled
        # What remembers more than its state must not share an `MjData`.
        remembers = model.nplugin > 0 or bool(model.opt.enableflags & _SLEEP_OR_IPC)
        num_envs = self.num_envs or 1
        self._remembers = remembers
        self._is_sharing = num_envs > _A_FEW and not remembers
        batch: Any = mujoco.batch.Batch(
            model, num_envs, self.num_threads, persistent=not self._is_sharing
        )
        self.is_orphan = False
        self.batch = batch
        self.state: np.ndarray = batch.state
        self.warnings: np.ndarray = batch.warning[..., 1]
        self._fields: dict[str, Any] = {name: batch.expand(name) for name in self._fields}
        self._disableflags = batch.expand("opt.disableflags")
        if midphase.is_needless(model, self._fields):
            batch.expand("body_bvhadr")[:, 0] = -1  # the world has no tree
        may_rest = False if remembers else sensors.may_rest(model, self._fields)
        self._resting: np.ndarray = may_rest & ~self._wanted  # sensors that are not computed
        if self._resting.any():
            self._sensor_stages = batch.expand("sensor_needstage")
            self._sensor_stages[:, self._resting] = _NEVER
        self._outputs: set[str] = set()  # fields that each call writes
        # Each row's last call, and the state that it began with, to be repeated for new outputs.
        self._was_called = False
        self._last_call = np.full(num_envs, _LOAD)
        self._before_call = self.state.copy()

    def abandon(self) -> None:
        """Called in a forked child, where the batch's threads are not: it must not be touched."""
        self.is_orphan = True
        # Never freed: its destructor would wait for threads that do not exist here.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.batch._b))
        forget = self.forget_arrays()
        if forget is not None:
            forget()

    def revive(self) -> None:
        """Makes an orphaned batch anew, in the state that it was in; does nothing to others."""
        if not self.is_orphan:
            return
        # The orphan can only be read: nothing may be asked of it that takes its threads.
        state, fields = self.state.copy(), {n: v.copy() for n, v in self._fields.items()}
        readings = self.batch.sensordata.copy() if "sensordata" in self._outputs else None
        calls = self._was_called, self._last_call, self._before_call
        self._make()
        for name, values in fields.items():
            self._fields[name][...] = values
        if self._constants:
            self.batch.set_const()
        self.state[...] = state
        self._was_called, self._last_call, self._before_call = calls
        if readings is not None:
            self.field_for_names("sensordata")
        self._repeat_calls()
        if readings is not None:
            self._set_sensordata(slice(None), readings)

    def step(self, nstep: int, rows: np.ndarray | None = None) -> None:
        """As `SingleSimulation.step`."""
        self._call(nstep, rows)

    def step_in_passing(self, nstep: int) -> None:
        """As `step`, of all rows, before another one: it is not remembered how to repeat it.

        What nobody has asked for yet must not be asked for until that step.
        """
        self._run(nstep, None)

    def step_whole(self, nstep: int, rows: np.ndarray | None = None) -> None:
        """As `SingleSimulation.step_whole`."""
        self._call(-nstep, rows)

    def roll_out(
        self, controls: np.ndarray, fields: Sequence[str], out: dict[str, np.ndarray] | None
    ) -> dict[str, np.ndarray]:
        """See `Rows.roll_out`."""
        items = {name: _TIME if name == "time" else name for name in fields}
        given = {items[name]: array for name, array in (out or {}).items() if name in items}
        begin(self)
        try:
            found = self.batch.rollout(
                controls.shape[1], controls, record=list(items.values()), out=given
            )
        finally:
            self.busy_in = None
            # There is nothing of it that could be repeated.
            self._was_called = True
            self._last_call[:] = _LOAD
            self._before_call[...] = self.state
        return {name: found[item] for name, item in items.items()}

    def forward_without_actuation(self, rows: np.ndarray | None = None) -> None:
        """As `SingleSimulation.forward_without_actuation`."""
        self._call(_START, rows)

    def _call(self, kind: int, rows: np.ndarray | None) -> None:
        """Lets MuJoCo do something with rows, which `_repeat_calls` can do again."""
        if rows is None:
            np.copyto(self._before_call, self.state)
            self._last_call.fill(kind)
        else:
            self._before_call[rows] = self.state[rows]
            self._last_call[rows] = kind
        self._was_called = True
        self._run(kind, rows)

    def _run(self, kind: int, rows: np.ndarray | None) -> None:
        begin(self)
        if kind == _START:
            flags = self._disableflags
            before = flags.copy()
            try:
                flags |= ACTUATION
                self.batch.forward(rows)
            finally:
                flags[...] = before
        elif kind == _LOAD:
            self.batch.forward(rows, _UP_TO_VELOCITY)
        elif kind > 0:
            self.batch.step(rows, kind, _UP_TO_VELOCITY)
        else:
            self.batch.step(rows, -kind)
        self.busy_in = None

    def _repeat_calls(self) -> None:
        """Does each row's last call again, which writes all outputs, and leaves all else as is."""
        kept = [(live, live.copy()) for live in (self.state, self.batch.warning)]
        readings = self.batch.sensordata.copy() if "sensordata" in self._outputs else None
        np.copyto(self.state, self._before_call)
        try:
            for kind in np.unique(self._last_call).tolist():
                self._run(kind, np.flatnonzero(self._last_call == kind))
        finally:
            for live, values in kept:
                np.copyto(live, values)
        if readings is not None:
            loaded = self._last_call == _LOAD
            self._set_sensordata(loaded, readings[loaded])

    def _set_sensordata(self, index: Any, values: np.ndarray) -> None:
        """Puts back readings that belong to the step before a `_LOAD`."""
        sensordata = self.batch.sensordata
        sensordata.flags.writeable = True  # an output otherwise, so not to be written
        sensordata[index] = values
        sensordata.flags.writeable = False

    def save(self, rows: Any, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """As `SingleSimulation.save`, of some rows or of all for None: (n, ...) each."""
        rows = slice(None) if rows is None else rows
        saved = {"state": self.state, "sensordata": self.data_field("sensordata")[0]}
        saved |= {name: self._fields[name] for name in fields}
        return {name: np.array(value[rows]) for name, value in saved.items()}

    def load(self, saved: dict[str, np.ndarray], rows: Any, constants: bool) -> None:
        """As `SingleSimulation.load`, into some rows or all for None."""
        index = slice(None) if rows is None else rows
        self.field_for_names("sensordata")
        self._load_state(saved, rows, constants)
        self._call(_LOAD, rows)
        self._set_sensordata(index, saved["sensordata"])

    def load_everywhere(self, saved: dict[str, np.ndarray], constants: bool) -> None:
        """Sets all rows to the one that `save` gave; what follows from its state does not follow.

        That is all that stepping them needs, or `roll_out`.
        """
        self._load_state(saved, None, constants)

    def _load_state(self, saved: dict[str, np.ndarray], rows: Any, constants: bool) -> None:
        index = slice(None) if rows is None else rows
        for name, value in saved.items():
            if name not in NOT_FIELDS:
                self._fields[name][index] = value
        if constants:
            self.batch.set_const(rows)
        if self._remembers:  # such as what has been lying still, and for how long
            self.batch.reset(rows, stage=_NOTHING)
        self.state[index] = saved["state"]

    def data_field(self, name: str) -> tuple[np.ndarray, bool]:
        """A field of the data, one row per simulation."""
        field = self.field_for_names(name)
        if name in sensors.FIELDS:
            self.want("sensordata", slice(None))
        return field

    def field_for_names(self, name: str) -> tuple[np.ndarray, bool]:
        """As `data_field`, for who says with `want` what of it is read."""
        self.revive()
        field = getattr(self.batch, name)
        if name not in self._outputs and isinstance(field, np.ndarray) and field.base is not None:
            if self._is_sharing and self._was_called and not field.flags.writeable:
                self._repeat_calls()  # MuJoCo would write a new output at the next call only
            self._outputs.add(name)
        return field, True

    def is_watched(self, name: str) -> bool:
        """Whether `want` is to be told what of a field is read."""
        return name == "sensordata"

    def want(self, name: str, columns: Any) -> bool:
        """Has the sensors of some columns of a field computed; whether any was not till now.

        Args:
          name: 'sensordata'.
          columns: an index for them.
        """
        if not self._resting.any():
            return False
        model = self._compiled
        sensor_of_column = np.repeat(np.arange(model.nsensor), model.sensor_dim)
        wanted = np.zeros(model.nsensor, bool)
        wanted[sensor_of_column[columns]] = True
        self._wanted |= wanted
        wanted &= self._resting
        if not wanted.any():
            return False
        self._sensor_stages[:, wanted] = model.sensor_needstage[wanted]
        self._resting &= ~wanted
        if self._was_called:
            self._repeat_calls()
        return True

    def model_field(self, name: str) -> tuple[np.ndarray, bool]:
        """A field of the model, and whether each row has values of its own."""
        self.revive()
        if name in self._fields:
            return self._fields[name], True
        field = getattr(self._compiled, name)
        if isinstance(field, np.ndarray):
            field = field.view()
            field.flags.writeable = False  # the rows would not notice
        return field, False

    def set_fields(self, values: dict[str, np.ndarray], row: int, constants: bool) -> None:
        """As `SingleSimulation.set_fields`, of one row."""
        for name, value in values.items():
            self._fields[name][row] = value
        if constants:
            self.batch.set_const([row])

    def copy_fields_out(self, row: int, single: SingleSimulation, constants: bool) -> None:
        """Copies a row's own fields to a single simulation."""
        if self._fields:
            values = {name: field[row] for name, field in self._fields.items()}
            single.set_fields(values, constants=constants)

    def copy_fields_in(self, row: int, model: MjModel) -> None:
        """Copies a single simulation's fields to a row."""
        for name, values in self._fields.items():
            values[row] = read_field(model._model, name)


# Batches whose threads a fork would leave behind.
_alive: "weakref.WeakSet[BatchSimulation]" = weakref.WeakSet()


def _abandon_all() -> None:
    for simulation in list(_alive):
        simulation.abandon()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_abandon_all)
