"""Random joint positions for the start of an episode."""

from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco import Physics

__all__ = ["random_limited_quaternion", "randomize_limited_and_rotational_joints"]

_HINGE = mujoco.mjtJoint.mjJNT_HINGE.value
_SLIDE = mujoco.mjtJoint.mjJNT_SLIDE.value
_BALL = mujoco.mjtJoint.mjJNT_BALL.value
_FREE = mujoco.mjtJoint.mjJNT_FREE.value


def random_limited_quaternion(random: np.random.RandomState, limit: float) -> np.ndarray:
    """A rotation by at most `limit` radians about a random axis, (4,)."""
    axis = random.randn(3)
    axis /= np.linalg.norm(axis)
    angle = random.rand() * limit
    quaternion = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, axis, angle)
    return quaternion


def randomize_limited_and_rotational_joints(
    physics: Physics, random: np.random.RandomState | None = None
) -> None:
    """Draws the positions of all limited or rotational joints, in the model's order.

    Limited hinges and slides are uniform within their limits, unlimited hinges within [-pi, pi].
    Ball joints are uniform over rotations, or over axis and angle within their limit. Free joints
    get a random rotation and keep their position; unlimited slides are unchanged.

    Args:
      physics: a `mujoco.Physics`; its `qpos` is written.
      random: the stream to draw from; NumPy's global stream by default.
    """
    stream: Any = random or np.random  # a `RandomState`, or the module with its methods
    model, qpos = physics.model._official, physics.data.qpos
    joints = zip(
        model.jnt_type.tolist(),
        model.jnt_limited.tolist(),
        model.jnt_range.tolist(),
        model.jnt_qposadr.tolist(),
        strict=True,
    )
    for kind, is_limited, (lower, upper), start in joints:
        if kind in (_HINGE, _SLIDE):
            if is_limited:
                qpos[start] = stream.uniform(lower, upper)
            elif kind == _HINGE:
                qpos[start] = stream.uniform(-np.pi, np.pi)
        elif kind == _BALL and is_limited:
            qpos[start : start + 4] = random_limited_quaternion(stream, upper)
        elif kind == _BALL:
            quaternion = stream.randn(4)
            qpos[start : start + 4] = quaternion / np.linalg.norm(quaternion)
        elif kind == _FREE and not is_limited:
            # As in dm_control, from one orthant only; published results depend on it.
            quaternion = stream.rand(4)
            qpos[start + 3 : start + 7] = quaternion / np.linalg.norm(quaternion)
