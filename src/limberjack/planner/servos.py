"""Servos in the planning model, which follow a plan's targets within one call of MuJoCo.

    servos = Servos(model, law)  # changes the planning model
    diverged = servos.follow(rollouts, plans, phases, substeps=4, interval=2)

A motor that the law turns to an angle becomes a servo of MuJoCo's with the law's constants. It
follows the target at each time step, where the law holds its controls for a control step. All
controls are then known before the rollout: they are the targets.
"""

import mujoco
import numpy as np

from limberjack.planner.control_law import ControlLaw
from limberjack.planner.rollouts import Rollouts
from limberjack.planner.spline import knot_weights

__all__ = ["Servos"]

# Fields recorded of the state after a step; all others are of the state before it.
_OF_THE_STATE = {
    *("act", "ctrl", "eq_active", "mocap_pos", "mocap_quat", "qacc_warmstart", "qfrc_applied"),
    *("qpos", "qvel", "time", "userdata", "xfrc_applied"),
}


class Servos:
    """The servos of a planning model."""

    def __init__(self, model: mujoco.MjModel, law: ControlLaw) -> None:
        """Turns the motors of a raw `mujoco.MjModel` that the law turns to angles into servos.

        Raises:
          ValueError: a motor has dynamics, or a gain that is not constant, or is 0.
        """
        self._follows = law.follows
        self._strength = np.where(law.follows, model.actuator_gainprm[:, 0], 1.0)
        for motor in np.flatnonzero(law.follows).tolist():
            is_plain = model.actuator_gaintype[motor] == mujoco.mjtGain.mjGAIN_FIXED.value
            is_plain &= model.actuator_dyntype[motor] == mujoco.mjtDyn.mjDYN_NONE.value
            moves = self._strength[motor] * model.actuator_gear[motor, 0] != 0
            if not is_plain or not moves:
                raise ValueError(
                    f"actuator {motor} is no motor whose force is its control times a constant "
                    "other than 0: plan without Settings(servos=True)"
                )
            self._build_in(model, law, motor)

    def _build_in(self, model: mujoco.MjModel, law: ControlLaw, motor: int) -> None:
        strength, gear = self._strength[motor], model.actuator_gear[motor, 0]
        low, high = sorted((law.low[motor] * strength, law.high[motor] * strength))
        if model.actuator_forcelimited[motor]:
            low = max(low, model.actuator_forcerange[motor, 0])
            high = min(high, model.actuator_forcerange[motor, 1])
        gain, damping = law.gain[motor] * strength, law.damping[motor] * strength
        model.actuator_gainprm[motor, 0] = gain
        model.actuator_biastype[motor] = mujoco.mjtBias.mjBIAS_AFFINE.value
        # The length that a servo knows is the angle times the gear.
        model.actuator_biasprm[motor, :3] = 0.0, -gain / gear, -damping / gear
        model.actuator_ctrllimited[motor] = False
        model.actuator_forcelimited[motor] = np.isfinite([low, high]).all()
        model.actuator_forcerange[motor] = low, high

    def follow(
        self,
        rollouts: Rollouts,
        plans: np.ndarray,
        phases: np.ndarray,
        substeps: int,
        interval: int,
    ) -> np.ndarray:
        """Follows a plan in each simulation, and records states; see `ControlLaw.follow`."""
        rollouts.history.begin()
        steps = len(phases)
        # One more time step, after which what follows from the last state is known.
        at = np.minimum(np.arange(steps * substeps + 1) // substeps, steps - 1)
        controls = knot_weights(plans.shape[1], phases[at]) @ plans
        first = ((steps - 1) % interval + 1) * substeps
        fields = rollouts.history.fields
        try:
            records, diverged = rollouts.roll_out(controls, [*fields, "actuator_force"])
        except ValueError as error:
            raise ValueError(
                f"step_cost reads what cannot be recorded along the way ({error}): plan without "
                "Settings(servos=True)"
            ) from error

        def values_of(field: str, columns: slice) -> np.ndarray:
            early = field in _OF_THE_STATE
            times = slice(first - early, steps * substeps + 1 - early, interval * substeps)
            values = records[field].reshape(*records[field].shape[:2], -1)[:, times, columns]
            if field == "ctrl":  # the law's controls
                force = records["actuator_force"][:, times, columns] / self._strength[columns]
                values = np.where(self._follows[columns], force, values)
            return values.swapaxes(0, 1)

        rollouts.history.record_all(values_of)
        return diverged
