"""The control law that follows a plan's targets.

    law = ControlLaw(model, settings)
    controls = law.controls(targets_at(knots, 0.3), qpos, qvel)  # (..., nu)
    diverged = law.follow(rollouts, plans, phases, substeps=4, interval=1)

A plan is a spline of targets: joint angles for actuators that turn a joint, on request the mean
angle for one that turns several by a fixed tendon, controls for others. A plan of angles stays
good when the state differs from the predicted one; a plan of torques does not.
"""

import mujoco
import numpy as np

from limberjack.planner.rollouts import Rollouts
from limberjack.planner.settings import Settings
from limberjack.planner.spline import targets_at

__all__ = ["ControlLaw", "joints_of_tendon"]

_UNLIMITED = -np.inf, np.inf


class ControlLaw:
    """A proportional law with damping, within the controls' limits."""

    def __init__(self, model: mujoco.MjModel, settings: Settings) -> None:
        """Takes a raw `mujoco.MjModel`, and the settings' gain, damping and tendons."""
        turned = [_joints_of(model, actuator, settings.tendons) for actuator in range(model.nu)]
        # An actuator that is a servo already takes its target as control.
        is_motor = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE.value
        self.follows: np.ndarray = is_motor & np.array([len(of) > 0 for of in turned], bool)
        # Factors of a state that give the actuators' angles, or their velocities.
        self._positions = np.zeros((model.nq, model.nu))
        self._velocities = np.zeros((model.nv, model.nu))
        limited = model.actuator_ctrllimited.astype(bool)
        limits = np.where(limited[:, None], model.actuator_ctrlrange, _UNLIMITED)
        self.low, self.high = limits.T
        ranges = limits.copy()
        for actuator in np.flatnonzero(self.follows):
            first = turned[actuator][0][0]  # the joint whose limits count
            ranges[actuator] = model.jnt_range[first] if model.jnt_limited[first] else _UNLIMITED
            for joint, part in turned[actuator]:
                self._positions[model.jnt_qposadr[joint], actuator] = part
                self._velocities[model.jnt_dofadr[joint], actuator] = part
        self._angles, self._rates = _picked(self._positions), _picked(self._velocities)
        self.gain: np.ndarray = np.where(self.follows, settings.gain, 1.0)
        self.damping: np.ndarray = np.where(self.follows, settings.damping, 0.0)
        # A target may lie beyond a joint's limit, so that the joint is pressed against it.
        reach = self.follows / settings.gain
        self._lowest, self._highest = ranges[:, 0] - reach, ranges[:, 1] + reach
        half = np.where(limited, (self.high - self.low) / 2, 1.0)
        # Scale of the noise of each target.
        self.scale: np.ndarray = np.where(self.follows, 1.0, half)

    def held(self, qpos: np.ndarray) -> np.ndarray:
        """The targets that keep the current angles, and no control elsewhere, (nu,)."""
        return self.within_limits(qpos @ self._positions)

    def within_limits(self, targets: np.ndarray) -> np.ndarray:
        """Targets that make sense, (..., nu): angles and controls within their ranges."""
        return np.clip(targets, self._lowest, self._highest)

    def controls(self, targets: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Controls of the actuators, (..., nu), for targets (..., nu) and the state."""
        wanted = targets - _turned(qpos, self._positions, self._angles)
        wanted *= self.gain
        if self.damping.any():
            wanted -= self.damping * _turned(qvel, self._velocities, self._rates)
        np.maximum(wanted, self.low, out=wanted)
        return np.minimum(wanted, self.high, out=wanted)

    def follow(
        self,
        rollouts: Rollouts,
        plans: np.ndarray,
        phases: np.ndarray,
        substeps: int,
        interval: int,
    ) -> np.ndarray:
        """Follows a plan in each simulation, and records states; returns which diverged, (N,).

        Args:
          rollouts: N simulations.
          plans: splines of targets, (N, knots, nu).
          phases: of the control steps in these, (steps,).
          substeps: time steps of a control step.
          interval: control steps from one recorded state to the next; the last state is recorded.
        """
        batch, history = rollouts.physics, rollouts.history
        qpos, qvel = batch.data.qpos, batch.data.qvel
        history.begin()
        for step, targets in enumerate(targets_at(plans, phases), 1 - len(phases)):
            batch.set_control(self.controls(targets, qpos, qvel))
            rollouts.simulation.step(substeps)
            if step % interval == 0:  # counted from the end
                history.record(step // interval - 1)
        return rollouts.diverged()


def _picked(parts: np.ndarray) -> np.ndarray | None:
    """Which number of a state each actuator turns, (nu,); None if it is not just one of them."""
    is_one = ((parts == 0.0) | (parts == 1.0)).all() and (parts.sum(axis=0) == 1.0).all()
    return parts.argmax(axis=0) if is_one else None


def _turned(state: np.ndarray, parts: np.ndarray, picked: np.ndarray | None) -> np.ndarray:
    """Angles that actuators turn, (..., nu): the state times its parts, or picked from it."""
    return state @ parts if picked is None else state.take(picked, axis=-1)


def _joints_of(model: mujoco.MjModel, actuator: int, tendons: bool) -> list[tuple[int, float]]:
    """The joints with one axis that an actuator turns, and their parts in its length."""
    kind, target = model.actuator_trntype[actuator], int(model.actuator_trnid[actuator, 0])
    if kind == mujoco.mjtTrn.mjTRN_TENDON.value and tendons:
        return joints_of_tendon(model, target)
    one_axis = mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value
    is_joint = kind == mujoco.mjtTrn.mjTRN_JOINT.value and model.jnt_type[target] in one_axis
    return [(target, 1.0)] if is_joint else []


def joints_of_tendon(model: mujoco.MjModel, tendon: int) -> list[tuple[int, float]]:
    """The joints that a fixed tendon couples, and their coefficients; none for a spatial tendon."""
    first = model.tendon_adr[tendon]
    wraps = slice(first, first + model.tendon_num[tendon])
    if (model.wrap_type[wraps] != mujoco.mjtWrap.mjWRAP_JOINT.value).any():
        return []
    return list(zip(model.wrap_objid[wraps].tolist(), model.wrap_prm[wraps].tolist(), strict=True))
