"""The control law that follows a plan's targets.

    law = ControlLaw(model, gain=1.5, damping=0.0)
    controls = law.controls(targets_at(knots, 0.3), qpos, qvel)  # (..., nu)

A plan is a spline of targets: joint angles for actuators that turn a joint, on request the mean
angle for one that turns several by a fixed tendon, controls for others.
A plan of angles stays good when the state differs from the predicted one; a plan of torques does
not. It knows nothing of costs or planning.
"""

from typing import Any

import mujoco
import numpy as np

__all__ = ["ControlLaw", "joints_of_tendon"]


class ControlLaw:
    """A proportional law with damping, within the controls' limits."""

    def __init__(self, model: Any, gain: float, damping: float, tendons: bool = False) -> None:
        """Takes a raw `mujoco.MjModel` and the law's constants; see `Settings`."""
        turned = [_joints_of(model, actuator, tendons) for actuator in range(model.nu)]
        # An actuator that is a servo already takes its target as control.
        is_motor = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE.value
        follows = is_motor & np.array([len(of) > 0 for of in turned], bool)
        self.follows: np.ndarray = follows
        # Factors of a state that give the actuators' angles, or their velocities.
        self._positions = np.zeros((model.nq, model.nu))
        self._velocities = np.zeros((model.nv, model.nu))
        first = np.zeros(model.nu, int)  # the joint whose limits count
        for actuator in np.flatnonzero(follows):
            first[actuator] = turned[actuator][0][0]
            for joint, part in turned[actuator]:
                self._positions[model.jnt_qposadr[joint], actuator] = part
                self._velocities[model.jnt_dofadr[joint], actuator] = part
        self._angles, self._rates = _picked(self._positions), _picked(self._velocities)
        self.gain: np.ndarray = np.where(follows, gain, 1.0)
        self.damping: np.ndarray = np.where(follows, damping, 0.0)
        self._is_damped = bool(self.damping.any())
        limited = model.actuator_ctrllimited.astype(bool)[:, None]
        limits = np.where(limited, model.actuator_ctrlrange, [-np.inf, np.inf])
        self.low, self.high = limits[:, 0], limits[:, 1]
        joint_limited = model.jnt_limited[first].astype(bool)[:, None]
        ranges = np.where(joint_limited, model.jnt_range[first], [-np.inf, np.inf])
        # A target may lie beyond a joint's limit, so that the joint is pressed against it.
        reach = 1.0 / gain
        self._lowest = np.where(follows, ranges[:, 0] - reach, self.low)
        self._highest = np.where(follows, ranges[:, 1] + reach, self.high)
        half = np.where(limited[:, 0], (self.high - self.low) / 2, 1.0)
        # Scale of the noise of each target.
        self.scale: np.ndarray = np.where(follows, 1.0, half)

    def held(self, qpos: np.ndarray) -> np.ndarray:
        """The targets that keep the current angles, and no control elsewhere, (nu,)."""
        return np.clip(qpos @ self._positions, self._lowest, self._highest)

    def within_limits(self, targets: np.ndarray) -> np.ndarray:
        """Targets that make sense, (..., nu): angles and controls within their ranges."""
        return np.clip(targets, self._lowest, self._highest)

    def controls(self, targets: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Controls of the actuators, (..., nu), for targets (..., nu) and the state."""
        wanted = targets - _turned(qpos, self._positions, self._angles)
        wanted *= self.gain
        if self._is_damped:
            wanted -= self.damping * _turned(qvel, self._velocities, self._rates)
        np.maximum(wanted, self.low, out=wanted)
        return np.minimum(wanted, self.high, out=wanted)


def _picked(parts: np.ndarray) -> np.ndarray | None:
    """Which number of a state each actuator turns, (nu,); None if it is not just one of them."""
    is_whole = bool(((parts == 0.0) | (parts == 1.0)).all())
    is_one = bool((parts.sum(axis=0) == 1.0).all())
    return parts.argmax(axis=0) if is_whole and is_one else None


def _turned(state: np.ndarray, parts: np.ndarray, picked: np.ndarray | None) -> np.ndarray:
    """Angles that actuators turn, (..., nu): the state times its parts, or picked from it."""
    return state @ parts if picked is None else state.take(picked, axis=-1)


def _joints_of(model: Any, actuator: int, tendons: bool) -> list[tuple[int, float]]:
    """The joints with one axis that an actuator turns, and their parts in its length."""
    kind, target = model.actuator_trntype[actuator], int(model.actuator_trnid[actuator, 0])
    if kind == mujoco.mjtTrn.mjTRN_TENDON.value and tendons:
        return joints_of_tendon(model, target)
    one_axis = mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value
    is_joint = kind == mujoco.mjtTrn.mjTRN_JOINT.value and model.jnt_type[target] in one_axis
    return [(target, 1.0)] if is_joint else []


def joints_of_tendon(model: Any, tendon: int) -> list[tuple[int, float]]:
    """The joints that a fixed tendon couples, and their coefficients; none for a spatial tendon."""
    first = model.tendon_adr[tendon]
    wraps = slice(first, first + model.tendon_num[tendon])
    if (model.wrap_type[wraps] != mujoco.mjtWrap.mjWRAP_JOINT.value).any():
        return []
    return list(zip(model.wrap_objid[wraps].tolist(), model.wrap_prm[wraps].tolist(), strict=True))
