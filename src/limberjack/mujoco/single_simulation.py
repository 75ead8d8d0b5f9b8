"""`SingleSimulation`: one simulation, stepped with MuJoCo's own functions.

    simulation = SingleSimulation(wrapper.MjData(model))
    simulation.forward_without_actuation()
    simulation.step(5)

It implements `Simulation`, as `BatchSimulation` does. No other file steps MuJoCo.
"""

from collections.abc import Mapping, Sequence
from typing import Self

import mujoco
import numpy as np

from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.mujoco.simulation import (
    ACTUATION,
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
    write_field,
)
from limberjack.mujoco.wrapper.core import MjData, MjModel
from limberjack.mujoco.wrapper.integer_fields import check_values, is_checked
from limberjack.rl.contract import PhysicsError
from limberjack.worlds.appearance.looks import Look

__all__ = ["Advance", "SingleSimulation", "advance"]

# A model, its data, and the numbers of second halves, whole time steps and first halves to make.
Advance = tuple[mujoco.MjModel, mujoco.MjData, int, int, int]

_STEP = Call.STEP  # every step reads it, and an attribute of an enum takes longer
_RUNGE_KUTTA = mujoco.mjtIntegrator.mjINT_RK4.value


class SingleSimulation(CountsWarnings):
    """One simulation; see `limberjack.mujoco.simulation.Simulation`."""

    WHOLE = STATE  # signature, for `get_state`, of everything that a time step depends on
    num_envs: int | None = None
    sets_constants = False
    look: Look | None = None  # with which pictures are drawn; None for that of the model

    def __init__(self, data: MjData) -> None:
        self.data = data
        self._wrapper = data.model
        self._data: mujoco.MjData = data._data
        self.ctrl: np.ndarray = self._data.ctrl
        self.warnings: np.ndarray = self._data.warning.number
        self._no_warnings = bytes(self.warnings.nbytes)
        # Flags to restore if Ctrl-C interrupted a call while actuation was disabled.
        self._flags_before: int | None = None
        self._model_of_opt: mujoco.MjModel | None = None
        self._opt = mujoco.MjOption()
        # The last call, its count, and the state before it.
        self._call, self._count = Call.LOAD, 1
        self._before = np.empty(mujoco.mj_stateSize(self._wrapper._official, STATE))

    @property
    def model(self) -> MjModel:
        """The model."""
        return self._wrapper

    def step(self, nstep: int, rows: Rows = None) -> None:
        """See `Simulation`."""
        advance(*self.begin_step(checked_steps(nstep)))

    def step_whole(self, nstep: int, rows: Rows = None) -> None:
        """See `Simulation`."""
        advance(*self.begin_step_whole(checked_steps(nstep)))

    def begin_step(self, nstep: int) -> Advance:
        """Records the call `step(nstep)`, and returns the arguments of `advance` that make it.

        Args:
          nstep: a result of `checked_steps`.
        """
        pass_exit_guard()
        model, data = self._wrapper._official, self._data
        if self._flags_before is not None:
            model = self._model()
        self._call, self._count = _STEP, nstep
        mujoco.mj_getState(model, data, self._before, STATE)
        if model is not self._model_of_opt:  # accessing `opt` creates a new object each time
            self._model_of_opt, self._opt = model, model.opt
        if self._opt.integrator == _RUNGE_KUTTA:  # cannot be split into halves
            return model, data, 0, nstep, 1
        return model, data, 1, nstep - 1, 1

    def begin_step_whole(self, nstep: int) -> Advance:
        """Records the call `step_whole(nstep)`; the argument and result are as of `begin_step`."""
        pass_exit_guard()
        self._remember(Call.STEP_WHOLE, nstep)
        return self._model(), self._data, 0, nstep, 0

    def forward(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        self._remember(Call.FORWARD)
        mujoco.mj_forward(self._model(), self._data)

    def forward_without_actuation(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        model = self._model()
        shared = self._wrapper._shared
        self._remember(Call.START)
        if shared is not None:
            mujoco.mj_forward(shared.passive, self._data)
            return
        opt = model.opt
        self._flags_before = opt.disableflags
        try:
            opt.disableflags = self._flags_before | ACTUATION
            mujoco.mj_forward(model, self._data)
        finally:
            opt.disableflags = self._flags_before
        self._flags_before = None

    def reset(self, keyframe: int | None = None, rows: Rows = None) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        if keyframe is None:
            mujoco.mj_resetData(self._model(), self._data)
        else:
            mujoco.mj_resetDataKeyframe(self._model(), self._data, keyframe)
        self._remember(Call.LOAD)

    def get_state(self, signature: int) -> np.ndarray:
        """See `Simulation`."""
        pass_exit_guard()
        model = self._model()
        state = np.empty(mujoco.mj_stateSize(model, signature))
        mujoco.mj_getState(model, self._data, state, signature)
        return state

    def set_state(self, state: np.ndarray, signature: int) -> None:
        """See `Simulation`."""
        pass_exit_guard()
        mujoco.mj_setState(self._model(), self._data, state, signature)

    def save(self, rows: Rows, fields: Sequence[str]) -> dict[str, np.ndarray]:
        """See `Simulation`; one row."""
        model = self._model()
        saved = {
            "state": self.get_state(STATE),
            "sensordata": self._data.sensordata.copy(),
            "before": self._before.copy(),
            "call": np.array(int(self._call)),
            "count": np.array(self._count),
        }
        saved |= {name: np.array(read_field(model, name)) for name in fields}
        return {name: value[None] for name, value in saved.items()}

    def load(self, saved: Mapping[str, np.ndarray], rows: Rows = None) -> None:
        """See `Simulation`; one row.

        Raises:
          PhysicsError: MuJoCo would reject this state; nothing was changed.
        """
        state = saved["state"][0]
        _check(self._wrapper._official, state)
        fields = {name: value[0] for name, value in model_fields(saved).items()}
        if fields:
            self.set_fields(fields)
        earlier = self.set_warnings_aside()
        if not self._repeat(saved, state):
            self.set_state(state, STATE)
            mujoco.mj_step1(self._model(), self._data)
            self._remember(Call.LOAD)
            if "sensordata" in saved:
                self._data.sensordata[...] = saved["sensordata"][0]
        self.warnings[...] = 0 if earlier is None else earlier

    def _repeat(self, saved: Mapping[str, np.ndarray], state: np.ndarray) -> bool:
        """Repeats the saved call, if any; returns whether that reproduces the saved state.

        It does not if the state or the model was changed after that call.
        """
        if "call" not in saved or not can_be_repeated(saved["call"][0], saved["count"][0]):
            return False
        count = int(saved["count"][0])
        self.set_state(saved["before"][0], STATE)
        match Call(int(saved["call"][0])):
            case Call.STEP:
                mujoco.mj_step1(self._model(), self._data)  # the first half of its first step
                self.step(count)
            case Call.FORWARD:
                self.forward()
            case Call.START:
                self.forward_without_actuation()
            case _:
                self.step_whole(count)
        return self.get_state(STATE).tobytes() == state.tobytes()

    def copy(self, share_model: bool) -> Self:
        """A simulation in the same state, with a copy of the data and, optionally, of the model.

        Raises:
          PhysicsError: MuJoCo would reject this state.
        """
        new = type(self).__new__(type(self))
        data = self.data._make_copy(share_model=share_model)
        new.__setstate__((data, *self.__getstate__()[1:]))
        return new

    def __getstate__(self) -> tuple[MjData, bool, Call, int, np.ndarray]:
        return self.data, self.sets_constants, self._call, self._count, self._before.copy()

    def __setstate__(self, state: tuple[MjData, bool, Call, int, np.ndarray]) -> None:
        data, sets_constants, call, count, before = state
        self.__init__(data)
        self.sets_constants, self._before = sets_constants, before
        self._call, self._count = call, count
        _check(data.model._official, self.get_state(STATE))

    def set_fields(self, values: Mapping[str, np.ndarray], row: int | None = None) -> None:
        """See `Simulation`."""
        model = self._wrapper.own()
        check_values(model, values)
        for name, value in values.items():
            write_field(model if is_checked(name) else self._wrapper, name, value)
        self.set_constants()

    def set_constants(self, rows: Rows = None) -> None:
        """See `Simulation`."""
        if self.sets_constants:
            state = self.get_state(STATE)  # MuJoCo computes in the data and overwrites positions
            mujoco.mj_setConst(self._wrapper.own(), self._data)
            self.set_state(state, STATE)

    def data_field(self, name: str) -> Field:
        """See `Fields`; without a batch axis."""
        return getattr(self._data, name), False

    def model_field(self, name: str) -> Field:
        """See `Fields`; without a batch axis, and writable unless it is part of the structure."""
        return getattr(self._wrapper, name), False

    def _remember(self, call: Call, count: int = 1) -> None:
        self._call, self._count = call, count
        mujoco.mj_getState(self._wrapper._official, self._data, self._before, STATE)

    def _model(self) -> mujoco.MjModel:
        """The official model, with flags restored if an interrupt left actuation disabled."""
        model = self._wrapper._official
        if self._flags_before is not None:
            model.opt.disableflags = self._flags_before
            self._flags_before = None
        return model


def advance(
    model: mujoco.MjModel, data: mujoco.MjData, ends: int, wholes: int, begins: int
) -> None:
    """Makes second halves, whole time steps and first halves, of the numbers given.

    It calls only MuJoCo, which releases the GIL: threads with different data run in parallel.
    """
    if ends:
        mujoco.mj_step2(model, data)
    if wholes:
        mujoco.mj_step(model, data, wholes)
    if begins:
        mujoco.mj_step1(model, data)


def _check(model: mujoco.MjModel, state: np.ndarray) -> None:
    """Raises PhysicsError if MuJoCo would replace a state by the default pose."""
    if is_bad_state(model, state):
        positions = state[1 : 1 + model.nq]
        is_position = not (abs(positions) <= mujoco.mjMAXVAL).all()
        raise PhysicsError(
            f"data.{'qpos' if is_position else 'qvel'} has diverged: it is not finite or exceeds "
            "MuJoCo's bounds, so MuJoCo would replace the state by the default pose; reset first"
        )
