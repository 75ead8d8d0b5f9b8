"""The control law that follows a plan's targets.

    law = ControlLaw(model, settings)
    controls = law.controls(targets_at(knots, 0.3), qpos, qvel)  # (..., nu)
    diverged = law.follow(rollouts, plans, phases, substeps=4, interval=1)

A plan is a spline of targets: joint angles for actuators that turn a joint, on request the mean
angle for one that turns several by a fixed tendon, controls for others. A plan of angles stays
good when the state differs from the predicted one; a plan of torques does not.

Constants that the settings leave open are derived from the model, for each actuator.
"""

import mujoco
import numpy as np

from limberjack.planner.rollouts import Rollouts
from limberjack.planner.settings import Settings
from limberjack.planner.spline import targets_at

__all__ = ["ControlLaw", "joints_of_tendon"]

_UNLIMITED = -np.inf, np.inf

# Derived constants. A motor that reaches its full control at a quarter of its joint's range can
# press it against either limit, and plans are still fine-grained between them.
_FULL_CONTROL_AT = 0.25  # of the range
_LARGEST_ERROR = 0.5  # radians; a hinge with a wide range would hang limply otherwise
_DAMPING_RATIO = 0.5  # of critical damping: little overshoot, and swings are not stifled


class ControlLaw:
    """A proportional law with damping, within the controls' limits."""

    def __init__(self, model: mujoco.MjModel, settings: Settings) -> None:
        """Takes a raw `mujoco.MjModel`, and the settings' gain, damping and tendons."""
        turned = [_joints_of(model, actuator, settings.tendons) for actuator in range(model.nu)]
        # An actuator that is a servo already takes its target as control.
        is_motor = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE.value
        self.follows: np.ndarray = is_motor & np.array([len(of) > 0 for of in turned], bool)
        first = np.array([of[0][0] if of else 0 for of in turned], int)  # whose limits count
        if settings.gain is None:
            self.follows &= model.jnt_limited[first].astype(bool) & (_strength(model) != 0)
        # Factors of a state that give the actuators' angles, or their velocities.
        self._positions = np.zeros((model.nq, model.nu))
        self._velocities = np.zeros((model.nv, model.nu))
        limited = model.actuator_ctrllimited.astype(bool)
        limits = np.where(limited[:, None], model.actuator_ctrlrange, _UNLIMITED)
        self.low, self.high = limits.T
        ranges = limits.copy()
        for actuator in np.flatnonzero(self.follows):
            joint = first[actuator]
            ranges[actuator] = model.jnt_range[joint] if model.jnt_limited[joint] else _UNLIMITED
            for joint, part in turned[actuator]:
                self._positions[model.jnt_qposadr[joint], actuator] = part
                self._velocities[model.jnt_dofadr[joint], actuator] = part
        self._angles, self._rates = _picked(self._positions), _picked(self._velocities)
        pushes = np.where(_strength(model) < 0, -1.0, 1.0)  # a motor may turn its joint backwards
        given, damping = settings.gain, settings.damping
        gain = _derived_gain(model, first, limits) if given is None else given * pushes
        self.gain: np.ndarray = np.where(self.follows, gain, 1.0)
        damped = _derived_damping(model, first, self.gain) if damping is None else damping * pushes
        self.damping: np.ndarray = np.where(self.follows, damped, 0.0)
        # A target may lie beyond a joint's limit, so that the joint is pressed against it.
        reach = self.follows / np.abs(self.gain)
        self._lowest, self._highest = ranges[:, 0] - reach, ranges[:, 1] + reach
        half = np.where(limited, (self.high - self.low) / 2, 1.0)
        # Scale of the noise of each target, and the largest noise in units of it.
        self.scale: np.ndarray = np.where(self.follows, 1.0, half)
        self.noise = 1.0 if settings.noise is None else settings.noise
        if settings.noise is None:
            self.scale[self.follows] = _half_range(model, first)[self.follows]

    def narrow(self, low: np.ndarray, high: np.ndarray) -> None:
        """Keeps controls within these bounds too, (nu,) each, such as those of a task's actions."""
        self.low, self.high = np.maximum(self.low, low), np.minimum(self.high, high)

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

    def targets_of(self, controls: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """The targets for which `controls` gives these controls in a state, (..., nu)."""
        wanted = controls + self.damping * _turned(qvel, self._velocities, self._rates)
        angles = _turned(qpos, self._positions, self._angles)
        return np.where(self.follows, angles + wanted / self.gain, controls)

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
            rollouts.step(substeps)
            if step % interval == 0:  # counted from the end
                history.record(step // interval - 1)
        return rollouts.diverged()


def _strength(model: mujoco.MjModel) -> np.ndarray:
    """Force or torque on each actuator's joint per unit of control, (nu,)."""
    return model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0]


def _half_range(model: mujoco.MjModel, joints: np.ndarray) -> np.ndarray:
    """Half of the joints' ranges, of one without limits half a turn or a metre, (len(joints),)."""
    is_hinge = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE.value
    unlimited = np.where(is_hinge, np.pi, 1.0)
    low, high = model.jnt_range[joints].T
    return np.where(model.jnt_limited[joints], (high - low) / 2, unlimited)


def _derived_gain(model: mujoco.MjModel, joints: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Control per unit of error, (nu,): full control where the error is a part of the range."""
    full = np.abs(limits).max(axis=-1)
    full[np.isinf(full)] = 1.0
    is_hinge = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE.value
    error = 2 * _FULL_CONTROL_AT * _half_range(model, joints)
    error = np.where(is_hinge, np.minimum(error, _LARGEST_ERROR), error)
    return np.sign(_strength(model)) * full / error


def _derived_damping(model: mujoco.MjModel, joints: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Control per unit of velocity, (nu,): that of a damped spring of the joint's inertia."""
    dofs = model.jnt_dofadr[joints]
    inertia = 1.0 / np.maximum(model.dof_invweight0[dofs], mujoco.mjMINVAL)
    strength = _strength(model)
    wanted = 2 * _DAMPING_RATIO * np.sqrt(np.abs(gain * strength) * inertia)
    lacking = np.maximum(wanted - model.dof_damping[dofs], 0.0)
    return lacking / np.where(strength == 0, np.inf, strength)


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
