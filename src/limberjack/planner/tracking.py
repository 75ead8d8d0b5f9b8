"""From targets to controls: splines of targets, and the law that follows them.

    law = Tracking(model, gain=1.5, damping=0.0)
    controls = law.controls(targets_at(knots, 0.3), qpos, qvel)  # (..., nu)

A plan is a spline of targets: joint angles for actuators that turn a joint, controls for others.
Following angles keeps a plan good when the state is not quite what was foreseen; a plan of torques
would have to foresee it all. It knows nothing of costs or planning.
"""

from typing import Any

import mujoco
import numpy as np

__all__ = ["Tracking", "targets_at"]

_ON_A_JOINT = mujoco.mjtTrn.mjTRN_JOINT.value
_ONE_AXIS = (mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value)


def targets_at(knots: np.ndarray, place: float) -> np.ndarray:
    """A piecewise linear spline's value, (..., K, nu) -> (..., nu).

    Args:
      knots: targets at the places 0, 1, ... K-1.
      place: beyond the last knot its value holds.
    """
    last = knots.shape[-2] - 1
    place = min(max(place, 0.0), float(last))
    left = min(int(place), last - 1)
    part = place - left
    return (1.0 - part) * knots[..., left, :] + part * knots[..., left + 1, :]


class Tracking:
    """A proportional law with damping, within the controls' limits."""

    def __init__(self, model: Any, gain: float, damping: float) -> None:
        """Takes a raw `mujoco.MjModel` and the law's constants; see `Settings`."""
        joints = np.maximum(model.actuator_trnid[:, 0], 0)
        on_joint = (model.actuator_trntype == _ON_A_JOINT) & np.isin(
            model.jnt_type[joints], _ONE_AXIS
        )
        # An actuator that is a servo already takes its target as control.
        follows = on_joint & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE.value)
        self.follows: np.ndarray = follows
        self._positions = model.jnt_qposadr[joints]
        self._velocities = model.jnt_dofadr[joints]
        self._gain = np.where(follows, gain, 1.0)
        self._damping = np.where(follows, damping, 0.0)
        self._part = follows.astype(float)
        limited = model.actuator_ctrllimited.astype(bool)[:, None]
        limits = np.where(limited, model.actuator_ctrlrange, [-np.inf, np.inf])
        self.low, self.high = limits[:, 0], limits[:, 1]
        joint_limited = model.jnt_limited[joints].astype(bool)[:, None]
        ranges = np.where(joint_limited, model.jnt_range[joints], [-np.inf, np.inf])
        # A target may lie beyond a joint's limit, so that the joint is pressed against it.
        reach = 1.0 / gain
        self._lowest = np.where(follows, ranges[:, 0] - reach, self.low)
        self._highest = np.where(follows, ranges[:, 1] + reach, self.high)
        half = np.where(limited[:, 0], (self.high - self.low) / 2, 1.0)
        # What a change of 1 means for each target, for drawing noise.
        self.scale: np.ndarray = np.where(follows, 1.0, half)

    def held(self, qpos: np.ndarray) -> np.ndarray:
        """The targets that keep the present angles, and no control elsewhere, (nu,)."""
        return np.clip(self._part * qpos[self._positions], self._lowest, self._highest)

    def within_limits(self, targets: np.ndarray) -> np.ndarray:
        """Targets that make sense, (..., nu): angles and controls within their ranges."""
        return np.clip(targets, self._lowest, self._highest)

    def controls(self, targets: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """What the actuators are to do, (..., nu), given targets (..., nu) and the state."""
        wanted = self._gain * (targets - self._part * qpos[..., self._positions])
        if self._damping.any():
            wanted -= self._damping * qvel[..., self._velocities]
        return np.clip(wanted, self.low, self.high)
