"""`LazyBatch`: a MuJoCo batch that computes and copies only the fields that are read.

All optimisations of batches are in this file, and no other code depends on them. A field always has
the values that it would have in a single simulation. The techniques:

- **Rows share an `MjData`.** In a large batch, all rows of a thread share one: it stays in the
  processor's caches, and memory hardly grows with the number of rows. In a small batch each row has
  its own, so that a step continues from the results of the last one.
- **Fields are bound on first use.** The values that a thread computes for a row are copied out
  before the next row overwrites them, but only for bound fields. A field bound late was not copied
  in the last call, so it is recomputed by replaying that call.
- **Calls are replayed.** Each row's last call and the state before it are recorded. Repeating the
  call reproduces every quantity bit for bit. Snapshots are restored in the same way.
- **Acceleration and force sensors are disabled until they are read.** They do not affect the
  simulation. The humanoid has 31, which no task observes and which take 6 % of a step. Once read,
  they are enabled, and the last call is replayed.
- **The world body has no bounding volume tree** if contacts are the same without it: see
  `midphase`.

Data that MuJoCo keeps outside its state (plugins, sleeping islands) can be neither replayed nor
shared: for such models every row has an `MjData`, and all sensors are enabled.
"""

import ctypes
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Self

import mujoco
import mujoco.batch
import numpy as np

from limberjack.mujoco import midphase, row_fields
from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.mujoco.index import Axes, FieldIndexer
from limberjack.mujoco.simulation import (
    FORWARD,
    LOAD,
    START,
    Rows,
    can_be_repeated,
    is_bad_state,
)
from limberjack.utils.arrays import AnyArray

__all__ = ["LazyBatch", "check_callbacks"]

# Functions that return the installed callbacks, by the callbacks' names.
_CALLBACKS: dict[str, Callable[[], object]] = {
    name.removeprefix("get_"): getattr(mujoco, name)
    for name in dir(mujoco)
    if name.startswith("get_mjcb_")
}
# The same by name, because a chain of calls is twice as fast as a loop; a test counts them.
_act_bias, _act_dyn = mujoco.get_mjcb_act_bias, mujoco.get_mjcb_act_dyn
_act_gain, _contactfilter = mujoco.get_mjcb_act_gain, mujoco.get_mjcb_contactfilter
_control, _passive = mujoco.get_mjcb_control, mujoco.get_mjcb_passive
_sensor, _time = mujoco.get_mjcb_sensor, mujoco.get_mjcb_time
_C_FUNCTION = ctypes.CFUNCTYPE(None).__bases__  # the class of all functions of ctypes

_A_FEW = 256  # rows; in larger batches sharing is mostly faster and takes a twentieth of the memory

_STAGE = mujoco.mjtStage
_NEVER, _UP_TO_VELOCITY = _STAGE.mjSTAGE_NONE.value, _STAGE.mjSTAGE_VEL.value
_FROM_ACCELERATION = _STAGE.mjSTAGE_ACC.value
_SLEEP_OR_IPC = mujoco.mjtEnableBit.mjENBL_SLEEP.value | mujoco.mjtEnableBit.mjENBL_IPC.value

_READINGS = "sensordata"
# Fields that depend on disabled sensors: the readings, and quantities computed only for sensors.
_OF_SENSORS = (_READINGS, "cacc", "cfrc_int", "cfrc_ext")
# Sensors that read accelerations and forces, and write nothing but their readings.
_WITHOUT_EFFECT = [
    getattr(mujoco.mjtSensor, f"mjSENS_{name}").value
    for name in (
        *("ACCELEROMETER", "FORCE", "TORQUE", "TOUCH"),
        *("ACTUATORFRC", "JOINTACTFRC", "TENDONACTFRC", "JOINTLIMITFRC", "TENDONLIMITFRC"),
        *("FRAMELINACC", "FRAMEANGACC"),
    )
]


class LazyBatch:
    """See the module's docstring.

    Attributes:
      official: the `mujoco.batch.Batch`.
      state: integration state, (num_envs, nstate), live.
      warning: MuJoCo's warnings by type: last info and count, (num_envs, 7, 2), live.
      own: per-row model fields by name, indexed by row, live; see `row_fields`.
      remembers: whether MuJoCo keeps more per row than its state.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        num_envs: int,
        num_threads: int,
        own: Iterable[str],
        read_sensors: np.ndarray | None = None,
    ) -> None:
        """Creates a batch in the model's default state.

        Args:
          model: the shared model.
          num_envs: number of rows.
          num_threads: number of threads.
          own: model fields of which each row has its own copy.
          read_sensors: mask of sensors to enable from the start; none by default.
        """
        self.remembers = model.nplugin > 0 or bool(model.opt.enableflags & _SLEEP_OR_IPC)
        self._shares = num_envs > _A_FEW and not self.remembers
        self._model, self._num_threads = model, num_threads
        # Any: MuJoCo's batch has its fields as attributes.
        self.official: Any = mujoco.batch.Batch(
            model, num_envs, num_threads, persistent=not self._shares
        )
        self.state: np.ndarray = self.official.state
        self.warning: np.ndarray = self.official.warning
        self._fields = row_fields.of(self.official, model, num_envs, own)
        self.own = self._fields.own
        if midphase.is_needless(model, self.own):
            self._fields.write("body_bvhadr", 0, -1)  # no tree for the world body
        none = np.zeros(model.nsensor, bool)
        self._read_sensors = none if read_sensors is None else read_sensors
        self._disabled = none if self.remembers else _can_be_disabled(model, self.own)
        self._disabled = self._disabled & ~self._read_sensors
        if self._disabled.any():
            self._fields.write("sensor_needstage", self._disabled, _NEVER)
        self._bound: set[str] = set()
        self._was_called = False
        self.last_call = np.full(num_envs, LOAD)
        self.before_call = self.state.copy()

    def call(self, kind: int, rows: Rows = None) -> None:
        """Runs and records a MuJoCo call: a number of steps, or `START`, `FORWARD`, `LOAD`.

        Raises:
          ValueError: see `check_callbacks`; nothing was changed.
        """
        check_callbacks()
        if rows is None:
            np.copyto(self.before_call, self.state)
            self.last_call.fill(kind)
        else:
            self.before_call[rows] = self.state[rows]
            self.last_call[rows] = kind
        self._was_called = True
        self._run(kind, rows)

    def set_const(self, rows: Rows) -> None:
        """Recomputes the constants of rows' models after their fields were set (mj_setConst)."""
        pass_exit_guard()
        self._fields.set_const(rows)

    def shown(self, name: str) -> np.ndarray:
        """A per-row model field as an array, (num_envs, ...), live."""
        return self._fields.shown(name)

    def forget_calls(self) -> None:
        """Records the current state of each row as loaded, since what led to it is unknown."""
        self._was_called = True
        self.last_call[:] = LOAD
        self.before_call[...] = self.state

    def _run(self, kind: int, rows: Rows) -> None:
        pass_exit_guard()
        batch = self.official
        if kind == START:
            with self._fields.without_actuation(rows):
                batch.forward(rows)
        elif kind == LOAD:
            batch.forward(rows, _UP_TO_VELOCITY)
        elif kind == FORWARD:
            batch.forward(rows)
        elif kind > 0:
            batch.step(rows, kind, _UP_TO_VELOCITY)
        else:
            batch.step(rows, -kind)

    def _replay(self, rows: Rows = None) -> None:
        """Repeats the last calls to write all bound fields; changes nothing else."""
        kept = [(live, live.copy()) for live in (self.state, self.warning)]
        readings = self.official.sensordata.copy() if _READINGS in self._bound else None
        np.copyto(self.state, self.before_call)
        try:
            for kind in np.unique(self.last_call).tolist():
                self._run(kind, np.flatnonzero(self.last_call == kind))
        finally:
            for live, values in kept:
                np.copyto(live, values)
        if readings is not None:
            loaded = self.last_call == LOAD
            self._set_readings(loaded, readings[loaded])

    def field(self, name: str) -> np.ndarray:
        """A field of the data, (num_envs, ...), live, with the sensors it needs enabled."""
        field = self._bound_field(name)
        if name in _OF_SENSORS:
            self.enable_sensors(slice(None))
        return field

    def _bound_field(self, name: str) -> np.ndarray:
        field = getattr(self.official, name)
        if name not in self._bound and isinstance(field, np.ndarray) and field.base is not None:
            if self._shares and self._was_called and not field.flags.writeable:
                self._replay()
            self._bound.add(name)
        return field

    def field_for_names(self, name: str) -> np.ndarray:
        """Like `field`, for an indexer that enables only the sensors it reads: see `indexer`."""
        return self._bound_field(name) if name == _READINGS else self.field(name)

    def indexer(self, name: str, field: AnyArray, axes: Axes, batch: bool) -> FieldIndexer:
        """The indexer of a field returned by `field_for_names`."""
        if name == _READINGS:
            return _Sensors(self, name, field, axes, batch)
        return FieldIndexer(name, field, axes, batch)

    def enable_sensors(self, columns: AnyArray | slice) -> None:
        """Enables the sensors of some columns of `sensordata`, and recomputes their readings.

        Args:
          columns: an index into the columns.
        """
        if not self._disabled.any():
            return
        model = self._model
        sensor_of_column = np.repeat(np.arange(model.nsensor), model.sensor_dim)
        read = np.zeros(model.nsensor, bool)
        read[sensor_of_column[columns]] = True
        self._read_sensors = self._read_sensors | read
        read &= self._disabled
        if not read.any():
            return
        self._fields.write("sensor_needstage", read, model.sensor_needstage[read])
        self._disabled &= ~read
        if self._was_called:
            self._replay()

    def _set_readings(self, rows: np.ndarray | slice, values: np.ndarray) -> None:
        """Sets readings, which a loaded state keeps from the time step before it."""
        readings = self.official.sensordata
        readings.flags.writeable = True  # read-only for users, as an output
        readings[rows] = values
        readings.flags.writeable = False

    def save(self, rows: Rows) -> dict[str, np.ndarray]:
        """See `Simulation.save`; without model fields."""
        index = slice(None) if rows is None else rows
        saved = {"state": self.state, "sensordata": self.field(_READINGS)}
        saved |= {"before": self.before_call, "call": self.last_call}
        return {name: np.array(values[index]) for name, values in saved.items()}

    def seen(self, row: int) -> dict[str, np.ndarray]:
        """See `BatchSimulation.seen`."""
        call = self.last_call[row]
        if 0 < call < LOAD:  # positions and velocities belong to the state after the call
            return {"state": self.state[row, None]}
        saved = {"state": self.state, "before": self.before_call, "call": self.last_call}
        return {name: values[row, None] for name, values in saved.items()}

    def load(self, saved: Mapping[str, np.ndarray], rows: Rows) -> None:
        """Restores the result of `save`; per-row model fields must be set before."""
        rows = np.arange(len(self.state)) if rows is None else rows
        state = saved["state"]
        self._bound_field(_READINGS)
        if self.remembers:  # such as which bodies have been at rest, and for how long
            self.official.reset(rows, stage=_NEVER)
        counted = self.warning.copy()
        is_reached = self._repeat(saved, rows) if "call" in saved else np.zeros(len(rows), bool)
        left = rows[~is_reached]
        if left.size:
            self.state[left] = self.before_call[left] = state[~is_reached]
            self.last_call[left] = LOAD
            # Here MuJoCo would silently replace a bad state by the default pose. The next step
            # replaces it with a warning.
            is_good = ~is_bad_state(self._model, state[~is_reached])
            if is_good.any():
                self.call(LOAD, left[is_good])
            if _READINGS in saved:
                self._set_readings(left, saved[_READINGS][~is_reached])
        np.copyto(self.warning, counted)

    def _repeat(self, saved: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """Repeats the saved calls; returns which rows reach the saved states, (n,) booleans.

        A row misses its saved state if the state or the model was changed after that call.
        """
        calls, state = saved["call"], saved["state"]
        self.state[rows] = saved["before"]
        can_be = can_be_repeated(calls) & ~is_bad_state(self._model, state)
        can_be &= not self.remembers
        for kind in np.unique(calls[can_be]).tolist():
            self.call(kind, rows[can_be & (calls == kind)])
        reached = self.state[rows]
        same = reached.view(np.uint64) == np.ascontiguousarray(state).view(np.uint64)
        return can_be & same.all(axis=-1)

    def made_again(self, sets_constants: bool) -> Self:
        """A new batch in the same state as this one, which is only read, as in a forked child."""
        new = type(self)(
            self._model, len(self.state), self._num_threads, self.own, self._read_sensors
        )
        for name, values in self.own.items():
            new.own[name][...] = values[:]
        if sets_constants:
            new.set_const(None)
        new.state[...] = self.state
        new.last_call, new.before_call = self.last_call, self.before_call
        new._was_called = self._was_called
        readings = self.official.sensordata if _READINGS in self._bound else None
        if readings is not None:
            new._bound_field(_READINGS)
        new._replay()
        if readings is not None:
            new._set_readings(slice(None), readings)
        return new


class _Sensors(FieldIndexer):
    """Indexer of `sensordata` that enables the sensors it reads."""

    __slots__ = ("_lazy",)

    def __init__(
        self, lazy: LazyBatch, name: str, field: AnyArray, axes: Axes, batch: bool
    ) -> None:
        super().__init__(name, field, axes, batch)
        self._lazy = lazy

    def _resolve(self, key: object) -> tuple[AnyArray, AnyArray]:
        array, index = super()._resolve(key)
        self._lazy.enable_sensors(np.arange(array.shape[-1])[None][index])
        return array, index

    def __getattr__(self, name: str) -> Any:  # attributes of the array
        self._lazy.enable_sensors(slice(None))
        return getattr(self._field, name)

    def __array__(
        self, dtype: type | np.dtype | None = None, copy: bool | None = None
    ) -> np.ndarray:
        self._lazy.enable_sensors(slice(None))
        return super().__array__(dtype, copy)


def _can_be_disabled(model: mujoco.MjModel, own: Iterable[str]) -> np.ndarray:
    """Mask of sensors that affect only `_OF_SENSORS`, bit for bit, (nsensor,)."""
    # Plugins and callbacks may use the readings; sensors with a delay store them.
    remembered = model.nhistory or model.sensor_interval.any() or model.sensor_delay.any()
    if model.nplugin or remembered or _any_callback():
        return np.zeros(model.nsensor, bool)
    if any(field.startswith("sensor_") for field in own):
        return np.zeros(model.nsensor, bool)
    late = model.sensor_needstage == _FROM_ACCELERATION
    return late & np.isin(model.sensor_type, _WITHOUT_EFFECT)


def _any_callback() -> bool:
    """Whether the user has installed MuJoCo callbacks."""
    return any(get() is not None for get in _CALLBACKS.values())


def check_callbacks() -> None:
    """Raises ValueError if a MuJoCo callback is a Python function, with which no batch runs.

    MuJoCo would raise too, but in the middle of a call. Takes 0.3 microseconds.
    """
    first = _act_bias() is _act_dyn() is _act_gain() is _contactfilter() is None
    if first and _control() is _passive() is _sensor() is _time() is None:
        return
    for name, get in _CALLBACKS.items():
        installed = get()
        if callable(installed) and not isinstance(installed, _C_FUNCTION):
            raise ValueError(
                f"{name} is a Python function, {installed!r}, and a batch runs only C callbacks: "
                f"remove it with mujoco.set_{name}(None), or install a function compiled in C "
                "through ctypes; nothing was stepped"
            )
