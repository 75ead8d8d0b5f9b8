"""Running MuJoCo: the only file that steps.

A simulation is one `MjData` or a batch of them on all cores, and knows nothing of names, tasks or
rendering. `limberjack.mujoco.Physics` is what users see of it.
"""

import logging
from collections.abc import Sequence
from typing import Any

import mujoco
import mujoco.batch
import numpy as np

from limberjack.mujoco.wrapper.core import MjData, MjModel

__all__ = ["BatchSimulation", "SingleSimulation"]

_log = logging.getLogger("limberjack")

_RUNGE_KUTTA = mujoco.mjtIntegrator.mjINT_RK4.value
_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION.value
_UP_TO_VELOCITY = mujoco.mjtStage.mjSTAGE_VEL.value


class SingleSimulation:
    """One simulation.

    `warnings` counts MuJoCo's warnings by kind, (7,) ints, live.
    """

    num_envs: int | None = None

    def __init__(self, data: MjData) -> None:
        self._wrapper = data.model
        self._data: Any = data._data
        self.warnings: np.ndarray = self._data.warning.number
        # The flags to put back if Ctrl-C came while actuation was disabled.
        self._flags_before: int | None = None

    def step(self, nstep: int) -> None:
        """Advances by `nstep` steps; positions and velocities are up to date afterwards.

        It finishes the step whose first half ran last and ends with the first half of the next,
        so that everything that depends on positions and velocities belongs to the new state.
        """
        model, data = self._model(), self._data
        if model.opt.integrator == _RUNGE_KUTTA:  # has no halves
            mujoco.mj_step(model, data, nstep)
        else:
            mujoco.mj_step2(model, data)
            if nstep > 1:
                mujoco.mj_step(model, data, nstep - 1)
        mujoco.mj_step1(model, data)

    def step_whole(self, nstep: int) -> None:
        """Advances by `nstep` whole steps; quantities belong to the state before the last one."""
        mujoco.mj_step(self._model(), self._data, nstep)

    def forward(self) -> None:
        """Recomputes every quantity from the state and the controls."""
        mujoco.mj_forward(self._model(), self._data)

    def forward_without_actuation(self) -> None:
        """Recomputes every quantity as if there were no actuators."""
        model = self._model()
        shared = self._wrapper._shared
        if shared is not None:
            mujoco.mj_forward(shared.passive, self._data)
            return
        opt = model.opt
        self._flags_before = opt.disableflags
        try:
            opt.disableflags = self._flags_before | _ACTUATION
            mujoco.mj_forward(model, self._data)
        finally:
            opt.disableflags = self._flags_before
        self._flags_before = None

    def reset(self, keyframe: int | None = None) -> None:
        """Returns to the model's default state or to a keyframe, without a forward pass."""
        if keyframe is None:
            mujoco.mj_resetData(self._model(), self._data)
        else:
            mujoco.mj_resetDataKeyframe(self._model(), self._data, keyframe)

    def data_field(self, name: str) -> tuple[np.ndarray, bool]:
        """A field of the data; it has no axis of simulations."""
        return getattr(self._data, name), False

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


class BatchData:
    """The fields of a batch's simulations, `data.qpos` (num_envs, nq) and so on, live."""

    def __init__(self, model: MjModel, batch: Any) -> None:
        self.model = model
        self._data = batch

    def __getattr__(self, name: str) -> Any:
        return getattr(self._data, name)


class BatchSimulation:
    """Many simulations of one model, stepped on a pool of threads.

    `state` holds what a step depends on, (num_envs, nstate), and `warnings` counts MuJoCo's warnings
    by kind, (num_envs, 7), both live. Rows are sorted arrays of row numbers, None for all.
    """

    def __init__(
        self, model: MjModel, num_envs: int, num_threads: int, episode_fields: Sequence[str]
    ) -> None:
        # Persistent, so that a step goes on from the stages that the last one ended with.
        batch = mujoco.batch.Batch(model._model, num_envs, num_threads, persistent=True)
        self.num_envs: int | None = num_envs
        self.data = BatchData(model, batch)
        self.state: np.ndarray = batch.state
        self.warnings: np.ndarray = batch.warning[..., 1]
        self._batch = batch
        self._fields = {name: batch.expand(name) for name in episode_fields}
        self._disableflags = batch.expand("opt.disableflags")

    def step(self, nstep: int, rows: np.ndarray | None = None) -> None:
        """As `SingleSimulation.step`."""
        self._batch.step(rows, nstep, _UP_TO_VELOCITY)

    def step_whole(self, nstep: int, rows: np.ndarray | None = None) -> None:
        """As `SingleSimulation.step_whole`."""
        self._batch.step(rows, nstep)

    def forward_without_actuation(self, rows: np.ndarray | None = None) -> None:
        """As `SingleSimulation.forward_without_actuation`."""
        flags = self._disableflags
        before = flags.copy()
        try:
            flags |= _ACTUATION
            self._batch.forward(rows)
        finally:
            flags[...] = before

    def data_field(self, name: str) -> tuple[np.ndarray, bool]:
        """A field of the data, one row per simulation."""
        return getattr(self._batch, name), True

    def model_field(self, name: str) -> tuple[np.ndarray, bool]:
        """A field of the model, and whether each row has values of its own."""
        if name in self._fields:
            return self._fields[name], True
        return getattr(self.data.model.ptr, name), False

    def copy_fields_out(self, row: int, model: MjModel) -> None:
        """Copies a row's own fields to a single simulation's model."""
        for name, values in self._fields.items():
            getattr(model.ptr, name)[...] = values[row]

    def copy_fields_in(self, row: int, model: MjModel) -> None:
        """Copies a single simulation's fields to a row."""
        for name, values in self._fields.items():
            values[row] = getattr(model._model, name)


def _log_warning(message: str | bytes) -> None:
    """Takes MuJoCo's warnings to Python's logging."""
    _log.warning("%s", message.decode() if isinstance(message, bytes) else message)


# Without a handler MuJoCo prints its warnings and writes MUJOCO_LOG.TXT in the working directory.
if mujoco.get_mju_user_warning() is None:
    mujoco.set_mju_user_warning(_log_warning)
