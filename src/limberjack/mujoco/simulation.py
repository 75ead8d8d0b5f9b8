"""Running MuJoCo: the only file that steps.

A simulation owns the state of one `MjData` (a batch of them is to have the same methods) and knows
nothing of names, tasks or rendering. `limberjack.mujoco.Physics` is what users see of it.
"""

import logging
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.wrapper.core import MjData

__all__ = ["SingleSimulation"]

_log = logging.getLogger("limberjack")

_RUNGE_KUTTA = mujoco.mjtIntegrator.mjINT_RK4.value
_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION.value


class SingleSimulation:
    """One simulation.

    `warnings` counts MuJoCo's warnings by kind, (7,) ints, live.
    """

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

    def _model(self) -> Any:
        """The official model; whole again, should an interrupt have left a flag switched."""
        model = self._wrapper._model
        if self._flags_before is not None:
            model.opt.disableflags = self._flags_before
            self._flags_before = None
        return model


def _log_warning(message: str | bytes) -> None:
    """Takes MuJoCo's warnings to Python's logging."""
    _log.warning("%s", message.decode() if isinstance(message, bytes) else message)


# Without a handler MuJoCo prints its warnings and writes MUJOCO_LOG.TXT in the working directory.
if mujoco.get_mju_user_warning() is None:
    mujoco.set_mju_user_warning(_log_warning)
