"""Joint positions that bring a site to a pose.

    result = qpos_from_site_pose(physics, "grip", target_pos=[0.2, 0.0, 0.5])
    if result.success:
        physics.data.qpos[:] = result.qpos

The search makes Gauss-Newton steps on the pose error, damped while it is large, and begins at the
current joint positions. Limits of joints and contacts are not considered. Names, arguments, results
and kinds of errors are dm_control's. Unlike the rest of `limberjack.utils`, this module needs
`limberjack.mujoco`.
"""

import collections
import operator
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from limberjack.mujoco import Physics
from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.utils.log import log

__all__ = ["IKResult", "nullspace_method", "qpos_from_site_pose"]

# Under dm_control's private names, which its own tests look up.
_INVALID_JOINT_NAMES_TYPE = (
    "joint_names is a {}; expected None for all joints, or a list, tuple or array of names"
)
_REQUIRE_TARGET_POS_OR_QUAT = (
    "target_pos and target_quat are both None; expected a position, an orientation or both"
)

IKResult = collections.namedtuple("IKResult", ["qpos", "err_norm", "steps", "success"])
IKResult.__doc__ = """The result of `qpos_from_site_pose`.

Attributes:
  qpos: joint positions, (nq,).
  err_norm: the error: distance in metres plus `rot_weight` times angle in radians. If the search
    ran out of steps, it is the error before the last update.
  steps: the number of updates before the one at which the search ended.
  success: whether the error came below `tol`.
"""


class _RefusedError(ValueError, IndexError, TypeError, UnboundLocalError):
    """Nothing to do: a ValueError, and each kind of error that dm_control raises then."""


def qpos_from_site_pose(
    physics: Physics,
    site_name: str,
    target_pos: ArrayLike | None = None,
    target_quat: ArrayLike | None = None,
    joint_names: Sequence[str] | np.ndarray | None = None,
    tol: float = 1e-14,
    rot_weight: float = 1.0,
    regularization_threshold: float = 0.1,
    regularization_strength: float = 3e-2,
    max_update_norm: float = 2.0,
    progress_thresh: float = 20.0,
    max_steps: int = 100,
    inplace: bool = False,
) -> IKResult:
    """Joint positions at which a site has a position, an orientation or both.

    Args:
      physics: a simulation; the search begins at its `qpos`.
      site_name: the site.
      target_pos: its position in the world, (3,), metres.
      target_quat: its orientation in the world, (4,).
      joint_names: the joints to move, in a list, tuple or array; all by default.
      tol: the error, as in `IKResult`, that counts as success.
      rot_weight: weight of an error of one radian, metres.
      regularization_threshold: the error above which updates are damped.
      regularization_strength: the damping; see `nullspace_method`.
      max_update_norm: the greatest norm of an update; longer ones are scaled.
      progress_thresh: the search ends at an error of more than this times the update's norm.
      max_steps: the greatest number of updates.
      inplace: whether to move `physics` itself, of which everything that depends on positions is
        then updated. By default it is unchanged.

    Returns:
      An `IKResult`, also if the search failed. Its `qpos` is a copy; if `inplace`, the live array.

    Raises:
      ValueError: no target, a position of another shape, joints in another type or none,
        `max_steps` below 1, or an unknown site.
      KeyError: an unknown joint.
      TypeError: an orientation of another shape, or a batch.
    """
    _check(physics, target_pos, target_quat, max_steps)
    site = physics.model.name2id(site_name, "site")
    dofs = _degrees_of_freedom(physics, joint_names)
    if not inplace:
        physics = physics.copy(share_model=True)
    search = _Search(physics, site, target_pos, target_quat, rot_weight)
    error, step = np.float64(np.inf), 0
    for step in range(max_steps):  # noqa: B007, since it is returned
        error = search.error()
        if error < tol:
            break
        strength = regularization_strength if error > regularization_threshold else 0.0
        update = nullspace_method(search.jacobian()[:, dofs], search.difference, strength)
        size = np.linalg.norm(update)
        with np.errstate(divide="ignore", invalid="ignore"):  # an update of 0 is no progress
            progress = error / size
        if progress > progress_thresh:
            break
        if size > max_update_norm:
            update *= max_update_norm / size
        search.move(dofs, update)
    else:
        log.warning("inverse kinematics did not converge in %d steps: error %g", max_steps, error)
    qpos = physics.data.qpos if inplace else physics.data.qpos.copy()
    return IKResult(qpos, error, step, bool(error < tol))


def _check(
    physics: Physics, target_pos: ArrayLike | None, target_quat: ArrayLike | None, max_steps: int
) -> None:
    """Refuses arguments with which a step would fail, before anything moves."""
    if target_pos is None and target_quat is None:
        raise ValueError(_REQUIRE_TARGET_POS_OR_QUAT)
    if getattr(physics, "num_envs", None) is not None:
        raise TypeError("physics is a batch; expected one simulation, such as env.physics")
    if operator.index(max_steps) < 1:
        raise _RefusedError(f"max_steps is {max_steps}; expected at least 1")
    if target_pos is not None:
        try:
            np.empty(3)[:] = np.subtract(target_pos, np.zeros(3))
        except ValueError:
            shape = np.shape(target_pos)
            raise ValueError(f"target_pos has shape {shape}; expected (3,)") from None
    if target_quat is not None:
        try:
            mujoco.mju_negQuat(np.empty(4), target_quat)
        except TypeError:
            raise TypeError(
                f"target_quat is {target_quat!r}; expected a quaternion as an array of shape (4,)"
            ) from None


def _degrees_of_freedom(physics: Physics, joint_names: object) -> slice | np.ndarray:
    """Index of the degrees of freedom of the named joints, each of which may have several."""
    if joint_names is None:
        return slice(None)
    if not isinstance(joint_names, list | tuple | np.ndarray):
        raise ValueError(_INVALID_JOINT_NAMES_TYPE.format(type(joint_names)))
    names = list(joint_names) if isinstance(joint_names, tuple) else joint_names
    if np.ndim(names) != 1 or not len(names):
        raise _RefusedError(f"joint_names is {joint_names!r}; expected a list of at least one name")
    return physics.named.model.dof_jntid.axes.row.convert_key_item(names)


class _Search:
    """A search in progress; `difference` is the pose error that `error` computed last."""

    def __init__(
        self,
        physics: Physics,
        site: int,
        target_pos: ArrayLike | None,
        target_quat: ArrayLike | None,
        rot_weight: float,
    ) -> None:
        self._model: mujoco.MjModel = physics.model._official  # only read
        self._data: mujoco.MjData = physics.data.ptr
        self._site = site
        self._target_pos, self._target_quat = target_pos, target_quat
        self._rot_weight = rot_weight
        rows = 3 * ((target_pos is not None) + (target_quat is not None))
        self.difference = np.empty(rows)
        self._jacobian = np.empty((rows, self._model.nv))
        pass_exit_guard()
        mujoco.mj_fwdPosition(self._model, self._data)

    def error(self) -> np.float64:
        """The weighted error of the pose; writes `difference`, metres and radians."""
        error = np.float64(0.0)
        if self._target_pos is not None:
            translation = self.difference[:3]
            translation[:] = np.subtract(self._target_pos, self._data.site_xpos[self._site])
            error += np.linalg.norm(translation)
        if self._target_quat is not None:
            rotation = self.difference[-3:]
            quat, turn = np.empty(4), np.empty(4)
            mujoco.mju_mat2Quat(quat, self._data.site_xmat[self._site])
            mujoco.mju_negQuat(quat, quat)
            mujoco.mju_mulQuat(turn, self._target_quat, quat)
            mujoco.mju_quat2Vel(rotation, turn, 1)
            error += np.linalg.norm(rotation) * self._rot_weight
        return error

    def jacobian(self) -> np.ndarray:
        """The derivative of the pose, (3 or 6, nv), by the degrees of freedom."""
        jac_pos = None if self._target_pos is None else self._jacobian[:3]
        jac_rot = None if self._target_quat is None else self._jacobian[-3:]
        mujoco.mj_jacSite(self._model, self._data, jac_pos, jac_rot, self._site)
        return self._jacobian

    def move(self, dofs: slice | np.ndarray, update: np.ndarray) -> None:
        """Moves joints by a displacement of the degrees of freedom `dofs`."""
        displacement = np.zeros(self._model.nv)
        displacement[dofs] = update
        pass_exit_guard()
        mujoco.mj_integratePos(self._model, self._data.qpos, displacement, 1)
        mujoco.mj_fwdPosition(self._model, self._data)


def nullspace_method(
    jac_joints: np.ndarray, delta: np.ndarray, regularization_strength: float = 0.0
) -> np.ndarray:
    """The least displacement of joints, (nv,), that comes closest to a displacement `delta`.

    Solves the normal equations. The damping is that of S. Buss, "Introduction to inverse kinematics
    with Jacobian transpose, pseudoinverse and damped least squares methods" (2004).

    Args:
      jac_joints: the Jacobian, (n, nv).
      delta: the displacement, (n,).
      regularization_strength: weight of the squared displacement of joints; 0 for none.

    Raises:
      AttributeError: `jac_joints` is not an array.
      ValueError: shapes do not fit together.
      LinAlgError: not solvable, as with NaN.
    """
    transposed = jac_joints.T
    hessian = transposed.dot(jac_joints)
    gradient = transposed.dot(delta)
    if not regularization_strength > 0:
        return np.linalg.lstsq(hessian, gradient, rcond=-1)[0]
    hessian += regularization_strength * np.eye(len(hessian))
    return np.linalg.solve(hessian, gradient)
