"""Quaternions, (4,) with the real part first."""

import mujoco
import numpy as np

__all__ = ["euler2quat", "mj_quat2vel", "mj_quatdiff", "mj_quatneg", "mj_quatprod"]


def euler2quat(ax: float, ay: float, az: float) -> np.ndarray:
    """The rotation by roll `ax`, pitch `ay` and yaw `az`, degrees, applied in that order."""
    halves = [np.deg2rad(degrees / 2) for degrees in (az, ay, ax)]
    cos_yaw, cos_pitch, cos_roll = map(np.cos, halves)
    sin_yaw, sin_pitch, sin_roll = map(np.sin, halves)
    return np.array(
        [
            cos_yaw * cos_pitch * cos_roll + sin_yaw * sin_pitch * sin_roll,
            cos_yaw * cos_pitch * sin_roll - sin_yaw * sin_pitch * cos_roll,
            cos_yaw * sin_pitch * cos_roll + sin_yaw * cos_pitch * sin_roll,
            sin_yaw * cos_pitch * cos_roll - cos_yaw * sin_pitch * sin_roll,
        ]
    )


def mj_quatprod(q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Product of two quaternions: the rotation `r` followed by `q`."""
    product = np.empty(4)
    mujoco.mju_mulQuat(product, np.ascontiguousarray(q), np.ascontiguousarray(r))
    return product


def mj_quat2vel(q: np.ndarray, dt: float) -> np.ndarray:
    """Angular velocity that performs the rotation in `dt` seconds, (3,), radians per second."""
    velocity = np.empty(3)
    mujoco.mju_quat2Vel(velocity, np.ascontiguousarray(q), dt)
    return velocity


def mj_quatneg(q: np.ndarray) -> np.ndarray:
    """The inverse rotation."""
    negated = np.empty(4)
    mujoco.mju_negQuat(negated, np.ascontiguousarray(q))
    return negated


def mj_quatdiff(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """The rotation from `source` to `target`, in the frame of `source`."""
    return mj_quatprod(mj_quatneg(source), target)
