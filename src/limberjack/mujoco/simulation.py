"""Running MuJoCo: with `batch_simulation.py`, for many, the only files that step.

A simulation knows nothing of names, tasks or rendering. `limberjack.mujoco.Physics` is what users
see of it.
"""

import operator
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.leaving import Busy, begin, watch
from limberjack.mujoco.wrapper.core import MjData
from limberjack.rl.contract import PhysicsError
from limberjack.utils.log import log

__all__ = ["ACTUATION", "NOT_FIELDS", "SingleSimulation", "read_field"]

ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION.value
NOT_FIELDS = ("state", "sensordata")  # what is saved beside the fields of the model

_RUNGE_KUTTA = mujoco.mjtIntegrator.mjINT_RK4.value
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION.value


class SingleSimulation(Busy):
    """One simulation.

    `warnings` counts MuJoCo's warnings by kind, (7,) ints, live.
    """

    num_envs: int | None = None
    is_orphan = False  # it has no threads to lose

    def __init__(self, data: MjData) -> None:
        self._wrapper = data.model
        self._data: Any = data._data
        self.warnings: np.ndarray = self._data.warning.number
        self._no_warnings = bytes(self.warnings.nbytes)
        # The flags to put back if Ctrl-C came while actuation was disabled.
        self._flags_before: int | None = None
        self._model_of_opt: Any = None
        self._opt: Any = None
        watch(self)

    def check_state(self) -> None:
        """Raises PhysicsError for a state that MuJoCo would replace by its default state."""
        for name in ("qpos", "qvel", "act"):
            if not (abs(getattr(self._data, name)) <= mujoco.mjMAXVAL).all():  # also of NaN
                raise PhysicsError(
                    f"data.{name} has diverged: a simulation is not copied or pickled like that, "
                    "because MuJoCo would replace its state by the default one; reset it first"
                )

    def set_warnings_aside(self) -> np.ndarray | None:
        """Clears the counters of warnings; returns what they were, None for none.

        A simulation that diverges is reset by MuJoCo, counters included, so that one that has
        counted before would show the same number.
        """
        if not self.has_warned():
            return None
        earlier = self.warnings.copy()
        self.warnings[...] = 0
        return earlier

    def has_warned(self) -> bool:
        """Whether any warning is counted."""
        return self.warnings.tobytes() != self._no_warnings

    def new_warnings(self, earlier: np.ndarray | None) -> np.ndarray | None:
        """Which kinds of warnings came since they were set aside, (7,); None for none."""
        new = self.warnings > 0 if self.has_warned() else None
        if earlier is not None:
            self.warnings += earlier
        return new

    def step(self, nstep: int) -> None:
        """Advances by `nstep` steps; positions and velocities are up to date afterwards.

        It finishes the step whose first half ran last and ends with the first half of the next,
        so that everything that depends on positions and velocities belongs to the new state.
        """
        model, data = self._model(), self._data
        begin(self)
        if model is not self._model_of_opt:  # asking for `opt` makes a new object each time
            self._model_of_opt, self._opt = model, model.opt
        if self._opt.integrator == _RUNGE_KUTTA:  # has no halves
            mujoco.mj_step(model, data, nstep)
        else:
            mujoco.mj_step2(model, data)
            if nstep > 1:
                mujoco.mj_step(model, data, nstep - 1)
        mujoco.mj_step1(model, data)
        self.busy_in = None

    def step_whole(self, nstep: int) -> None:
        """Advances by `nstep` whole steps; quantities belong to the state before the last one."""
        begin(self)
        mujoco.mj_step(self._model(), self._data, nstep)
        self.busy_in = None

    def forward(self) -> None:
        """Recomputes every quantity from the state and the controls."""
        begin(self)
        mujoco.mj_forward(self._model(), self._data)
        self.busy_in = None

    def forward_without_actuation(self) -> None:
        """Recomputes every quantity as if there were no actuators."""
        model = self._model()
        shared = self._wrapper._shared
        begin(self)
        if shared is not None and shared.is_public:
            mujoco.mj_forward(shared.passive, self._data)
            self.busy_in = None
            return
        opt = model.opt
        self._flags_before = opt.disableflags
        try:
            opt.disableflags = self._flags_before | ACTUATION
            mujoco.mj_forward(model, self._data)
        finally:
            opt.disableflags = self._flags_before
        self._flags_before = None
        self.busy_in = None

    def reset(self, keyframe: int | None = None) -> None:
        """Returns to the model's default state or to a keyframe, without a forward pass."""
        if keyframe is None:
            mujoco.mj_resetData(self._model(), self._data)
        else:
            mujoco.mj_resetDataKeyframe(self._model(), self._data, keyframe)

    def save(self, rows: Any, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """The state, sensor readings and fields of the model, copied, as one row: (1, ...) each."""
        model, data = self._model(), self._data
        state = np.empty(mujoco.mj_stateSize(model, _STATE))
        mujoco.mj_getState(model, data, state, _STATE)
        saved = {"state": state, "sensordata": data.sensordata.copy()}
        saved |= {name: np.array(read_field(model, name)) for name in fields}
        return {name: value[None] for name, value in saved.items()}

    def load(self, saved: dict[str, np.ndarray], rows: Any, constants: bool) -> None:
        """Sets what `save` gave, and recomputes what depends on positions and velocities."""
        fields = {n: value[0] for n, value in saved.items() if n not in NOT_FIELDS}
        if fields:
            self.set_fields(fields, constants=constants)
        mujoco.mj_setState(self._model(), self._data, saved["state"][0], _STATE)
        mujoco.mj_step1(self._model(), self._data)
        self._data.sensordata[...] = saved["sensordata"][0]

    def set_fields(
        self, values: dict[str, np.ndarray], row: int | None = None, constants: bool = False
    ) -> None:
        """Sets fields of the model, and redoes the constants that follow from them if asked to."""
        model = self._wrapper.ptr
        for name, value in values.items():
            field = read_field(model, name)
            if isinstance(field, np.ndarray):
                field[...] = value
            else:
                setattr(model.opt, name.removeprefix("opt."), value.item())
        if constants:
            mujoco.mj_setConst(model, self._data)

    def data_field(self, name: str) -> tuple[np.ndarray, bool]:
        """A field of the data; it has no axis of simulations."""
        return getattr(self._data, name), False

    field_for_names = data_field

    def is_watched(self, name: str) -> bool:
        """As `BatchSimulation.is_watched`: never, as all sensors are computed."""
        return False

    def want(self, name: str, columns: Any) -> bool:
        """Does nothing; see `BatchSimulation.want`."""
        return False

    def model_field(self, name: str) -> tuple[np.ndarray, bool]:
        """A field of the model, for anybody to change; it has no axis of simulations."""
        return getattr(self._wrapper.ptr, name), False

    def _model(self) -> Any:
        """The official model; whole again, should an interrupt have left a flag switched."""
        model = self._wrapper._model
        if self._flags_before is not None:
            model.opt.disableflags = self._flags_before
            self._flags_before = None
        return model


def read_field(model: Any, name: str) -> Any:
    """A field of a model, or of its options as 'opt.gravity'."""
    return operator.attrgetter(name)(model)


def _log_warning(message: str | bytes) -> None:
    """Takes MuJoCo's warnings to Python's logging."""
    log.warning("%s", message.decode() if isinstance(message, bytes) else message)


# Without a handler MuJoCo prints its warnings and writes MUJOCO_LOG.TXT in the working directory.
if mujoco.get_mju_user_warning() is None:
    mujoco.set_mju_user_warning(_log_warning)
