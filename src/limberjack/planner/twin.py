"""The physics that plans are tried in: the environment's own, as the `Settings` have it.

twin = twin_of(env.physics, settings)
let_rest(twin.model.ptr)  # what lies still sleeps
"""

from typing import Any

import mujoco
import numpy as np

from limberjack.planner.cost import Settings

__all__ = ["let_rest", "twin_of"]

_OF_TENDONS = mujoco.mjtEq.mjEQ_TENDON.value
_OF_JOINTS = mujoco.mjtEq.mjEQ_JOINT.value
_JOINT = mujoco.mjtWrap.mjWRAP_JOINT.value
_ONE_AXIS = (mujoco.mjtJoint.mjJNT_HINGE.value, mujoco.mjtJoint.mjJNT_SLIDE.value)


def twin_of(physics: Any, settings: Settings) -> Any:
    """A copy of an environment's physics, in its present state, with the settings' constants."""
    twin = physics.copy()
    model = twin.model.ptr  # its own from here on
    if settings.timestep is not None:
        twin.model.opt.timestep = settings.timestep
    if settings.armature:
        model.dof_armature[_actuated_hinges(model)] += settings.armature
    # At the end of a control step all quantities then belong to the state that it led to.
    twin.legacy_step = True
    return twin


def let_rest(model: Any) -> None:
    """Has MuJoCo leave out what lies still, till it is touched, in a raw `mujoco.MjModel`.

    MuJoCo lets nothing sleep beside an equality of tendons: one that couples two joints is written
    as what it is, an equality of these joints.

    Raises:
      ValueError: an equality of tendons couples anything else.
    """
    for equality in np.flatnonzero(model.eq_type == _OF_TENDONS).tolist():
        tendon = int(model.eq_obj1id[equality])
        wraps = slice(model.tendon_adr[tendon], model.tendon_adr[tendon] + model.tendon_num[tendon])
        joints, parts = model.wrap_objid[wraps], model.wrap_prm[wraps]
        is_plain = len(joints) == 2 and model.eq_obj2id[equality] < 0
        is_plain &= bool((model.wrap_type[wraps] == _JOINT).all())
        if not is_plain or not np.isin(model.jnt_type[joints], _ONE_AXIS).all():
            raise ValueError(
                f"equality {equality} is one of tendons that do not just couple two joints: plan "
                "without Settings(rest=True)"
            )
        dofs = model.jnt_dofadr[joints]
        # How stiff it is, MuJoCo estimates in another way for joints: that is put right.
        estimates = (
            model.tendon_invweight0[tendon] / parts[0] ** 2,
            model.dof_invweight0[dofs].sum(),
        )
        stiff = model.eq_solimp[equality, :2]
        stiff[:] = stiff / (stiff + (1.0 - stiff) * estimates[0] / estimates[1])
        model.eq_type[equality] = _OF_JOINTS
        model.eq_objtype[equality] = mujoco.mjtObj.mjOBJ_JOINT.value
        model.eq_obj1id[equality], model.eq_obj2id[equality] = joints
        # The first joint is a polynomial of the second one, where the tendon's length is constant.
        length = model.eq_data[equality, 0]
        model.eq_data[equality, :5] = length / parts[0], -parts[1] / parts[0], 0.0, 0.0, 0.0
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP.value


def _actuated_hinges(model: Any) -> np.ndarray:
    """Whether a degree of freedom is a hinge of what actuators move, (nv,)."""
    joints = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE.value)
    hinges = model.jnt_dofadr[joints]
    moved = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT.value
    trees = model.dof_treeid[model.jnt_dofadr[model.actuator_trnid[moved, 0]]]
    found = np.zeros(model.nv, bool)
    found[hinges[np.isin(model.dof_treeid[hinges], trees)]] = True
    return found
