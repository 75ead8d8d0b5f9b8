"""The planning model: the environment's own physics with the constants of `Settings`.

planning = planning_model_of(env.physics, settings)
enable_sleep(planning.model.ptr)  # bodies at rest sleep
"""

import mujoco
import numpy as np

from limberjack.mujoco.engine import Physics
from limberjack.planner.control_law import joints_of_tendon
from limberjack.planner.settings import Settings

__all__ = ["enable_sleep", "planning_model_of"]


def planning_model_of(physics: Physics, settings: Settings) -> Physics:
    """A copy of an environment's physics, in its present state, with the settings' constants."""
    planning = physics.copy()
    model = planning.model.ptr  # its own from here on
    if settings.timestep is not None:
        planning.model.opt.timestep = settings.timestep
    if settings.armature:
        model.dof_armature[_actuated_hinges(model)] += settings.armature
    # At the end of a control step all quantities then belong to the state that it led to.
    planning.legacy_step = True
    return planning


def _actuated_hinges(model: mujoco.MjModel) -> np.ndarray:
    """The degrees of freedom that are hinges of bodies that actuators move, (n,)."""
    moved = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT.value
    trees = model.dof_treeid[model.jnt_dofadr[model.actuator_trnid[moved, 0]]]
    hinges = model.jnt_dofadr[model.jnt_type == mujoco.mjtJoint.mjJNT_HINGE.value]
    return hinges[np.isin(model.dof_treeid[hinges], trees)]


def enable_sleep(model: mujoco.MjModel) -> None:
    """Lets MuJoCo skip bodies at rest until they are touched, in a raw `mujoco.MjModel`.

    Nothing sleeps beside an equality of tendons: one that couples two joints is rewritten as an
    equality of these joints.

    Raises:
      ValueError: an equality of tendons couples anything else.
    """
    of_tendons = model.eq_type == mujoco.mjtEq.mjEQ_TENDON.value
    for equality in np.flatnonzero(of_tendons).tolist():
        tendon = int(model.eq_obj1id[equality])
        coupled = joints_of_tendon(model, tendon)
        if len(coupled) != 2 or model.eq_obj2id[equality] >= 0:
            raise ValueError(
                f"equality {equality} is one of tendons that do not just couple two joints: plan "
                "without Settings(sleep=True)"
            )
        joints, parts = map(list, zip(*coupled, strict=True))
        # MuJoCo estimates the stiffness of joints in another way: this corrects for it.
        as_tendon = model.tendon_invweight0[tendon] / parts[0] ** 2
        as_joints = model.dof_invweight0[model.jnt_dofadr[joints]].sum()
        stiff = model.eq_solimp[equality, :2]
        stiff[:] = stiff / (stiff + (1.0 - stiff) * as_tendon / as_joints)
        model.eq_type[equality] = mujoco.mjtEq.mjEQ_JOINT.value
        model.eq_objtype[equality] = mujoco.mjtObj.mjOBJ_JOINT.value
        model.eq_obj1id[equality], model.eq_obj2id[equality] = joints
        # The first joint is a polynomial of the second one, where the tendon's length is constant.
        length = model.eq_data[equality, 0]
        model.eq_data[equality, :5] = length / parts[0], -parts[1] / parts[0], 0.0, 0.0, 0.0
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP.value
