"""From targets to controls: splines of targets, and the law that follows them.

    law = Tracking(model, gain=1.5, damping=0.0)
    controls = law.controls(targets_at(knots, 0.3), qpos, qvel)  # (..., nu)

A plan is a spline of targets: joint angles for actuators that turn a joint, on request the mean
angle for one that turns several by a fixed tendon, controls for others.
Following angles keeps a plan good when the state is not quite what was foreseen; a plan of torques
would have to foresee it all. It knows nothing of costs or planning.
"""

from typing import Any

import mujoco
import numpy as np

__all__ = ["Tracking", "shares_of_knots", "targets_at"]

_ON_A_TENDON = mujoco.mjtTrn.mjTRN_TENDON.value
_OF_JOINTS = mujoco.mjtWrap.mjWRAP_JOINT.value
_ON_A_JOINT = mujoco.mjtTrn.mjTRN_JOINT.value
_ONE_AXIS = (mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value)


def targets_at(knots: np.ndarray, places: float | np.ndarray) -> np.ndarray:
    """A piecewise linear spline's values, (..., K, nu) -> (places, ..., nu).

    Args:
      knots: targets at the places 0, 1, ... K-1.
      places: one or an array of them; beyond the last knot its value holds.
    """
    last = knots.shape[-2] - 1
    if isinstance(places, float):
        place = min(max(places, 0.0), float(last))
        left = min(int(place), last - 1)
        part = place - left
        return (1.0 - part) * knots[..., left, :] + part * knots[..., left + 1, :]
    places = np.minimum(np.maximum(places, 0.0), float(last))
    left = np.minimum(places.astype(int), last - 1)
    part = (places - left).reshape(places.shape + (1,) * (knots.ndim - 1))
    by_knot = np.moveaxis(knots, -2, 0)
    return (1.0 - part) * by_knot[left] + part * by_knot[left + 1]


def shares_of_knots(count: int, places: np.ndarray) -> np.ndarray:
    """What each of so many knots counts at places of a spline, (len(places), count).

    Times knots, (..., count, nu), these are the spline's values there, (..., len(places), nu).
    """
    return targets_at(np.eye(count), places)


class Tracking:
    """A proportional law with damping, within the controls' limits."""

    def __init__(self, model: Any, gain: float, damping: float, tendons: bool = False) -> None:
        """Takes a raw `mujoco.MjModel` and the law's constants; see `Settings`."""
        turned = [_joints_of(model, actuator, tendons) for actuator in range(model.nu)]
        # An actuator that is a servo already takes its target as control.
        is_motor = model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE.value
        follows = is_motor & np.array([len(of) > 0 for of in turned], bool)
        self.follows: np.ndarray = follows
        # What a state is multiplied with for what the actuators turn: angles, or their velocities.
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
        # What a change of 1 means for each target, for drawing noise.
        self.scale: np.ndarray = np.where(follows, 1.0, half)

    def held(self, qpos: np.ndarray) -> np.ndarray:
        """The targets that keep the present angles, and no control elsewhere, (nu,)."""
        return np.clip(qpos @ self._positions, self._lowest, self._highest)

    def within_limits(self, targets: np.ndarray) -> np.ndarray:
        """Targets that make sense, (..., nu): angles and controls within their ranges."""
        return np.clip(targets, self._lowest, self._highest)

    def controls(self, targets: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """What the actuators are to do, (..., nu), given targets (..., nu) and the state."""
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
    """What actuators turn, (..., nu): the state times its parts, which is quicker if picked."""
    return state @ parts if picked is None else state.take(picked, axis=-1)


def _joints_of(model: Any, actuator: int, tendons: bool) -> list[tuple[int, float]]:
    """The joints with one axis that an actuator turns, and their parts in its length."""
    kind, target = model.actuator_trntype[actuator], int(model.actuator_trnid[actuator, 0])
    if kind == _ON_A_JOINT:
        return [(target, 1.0)] if model.jnt_type[target] in _ONE_AXIS else []
    if kind != _ON_A_TENDON or not tendons:
        return []
    wraps = range(model.tendon_adr[target], model.tendon_adr[target] + model.tendon_num[target])
    if any(model.wrap_type[wrap] != _OF_JOINTS for wrap in wraps):
        return []
    return [(int(model.wrap_objid[wrap]), float(model.wrap_prm[wrap])) for wrap in wraps]
