"""The physics of plans: what the settings change in it, and what lies still in it."""

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import Settings
from limberjack.planner.planning_model import enable_sleep, planning_model_of
from limberjack.rl import control
from limberjack.suite import stacker

_SLEEP = mujoco.mjtEnableBit.mjENBL_SLEEP.value
_TENDONS = """
<mujoco>
  <worldbody>
    <body>
      <joint name="a" type="slide"/>
      <geom size=".1"/>
      <body>
        <joint name="b" type="slide"/>
        <geom size=".1"/>
        <body>
          <joint name="c" type="slide"/>
          <geom size=".1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="of">{joints}</fixed>
  </tendon>
  <equality>
    <tendon tendon1="of"/>
  </equality>
</mujoco>
"""


def _env(seed: int = 0) -> control.Environment:
    env = suite.load("stacker", "stack_4", {"random": seed})
    env.reset()
    return env


def _model(boxes: int) -> mujoco.MjModel:
    xml, assets = stacker.make_model(boxes)
    return mujoco.MjModel.from_xml_string(xml.decode(), assets)


def test_the_settings_change_the_twin_alone() -> None:
    env = _env()
    model = env.physics.model._official
    before = model.opt.timestep, model.dof_armature.copy()
    twin = planning_model_of(env.physics, Settings(timestep=0.005, armature=0.01))
    gained = twin.model._official.dof_armature - before[1]
    names = [env.physics.model.id2name(joint, "joint") for joint in range(model.njnt)]
    arm = [n.startswith("arm_") or "finger" in n or "thumb" in n for n in names]
    # All joints of the arm are hinges, and boxes are not part of it. What is added to some armature
    # and compared by subtracting it again rounds.
    np.testing.assert_allclose(gained, 0.01 * np.array(arm), rtol=0, atol=1e-15)
    assert twin.model.opt.timestep == 0.005
    for physics in (env.physics, _env().physics):
        assert physics.model._official.opt.timestep == before[0]
        np.testing.assert_array_equal(physics.model._official.dof_armature, before[1])


def test_what_lies_still_is_left_out_until_it_is_touched() -> None:
    model = _model(boxes=4)
    enable_sleep(model)
    data = mujoco.MjData(model)
    x = [model.joint(f"box{box}_x").qposadr[0] for box in range(4)]
    z = [model.joint(f"box{box}_z").qposadr[0] for box in range(4)]
    data.qpos[x], data.qpos[z] = [-0.3, -0.1, 0.1, 0.3], 0.022
    mujoco.mj_step(model, data, 400)
    trees = [int(model.body_treeid[model.body(f"box{box}").id]) for box in range(4)]
    assert (data.tree_asleep[trees] >= 0).all()
    at_rest = data.qpos[x].copy()
    data.qvel[model.joint("box1_x").dofadr[0]] = 2.0  # towards the third one
    mujoco.mj_step(model, data, 200)
    moved = np.abs(data.qpos[x] - at_rest)
    assert moved[2] > 0.01
    np.testing.assert_array_equal(moved[[0, 3]], 0.0)


def test_coupled_fingers_are_coupled_as_before() -> None:
    ends = []
    for change in (lambda model: None, enable_sleep):
        model = _model(boxes=2)
        change(model)
        data = mujoco.MjData(model)
        data.qpos[model.joint("thumb").qposadr[0]] = 0.3
        data.ctrl[-1] = 0.5
        mujoco.mj_step(model, data, 300)
        fingers = [data.joint(name).qpos[0] for name in ("thumb", "finger")]
        assert abs(fingers[0] - fingers[1]) < 0.05  # of 0.3 at first
        ends.append(fingers)
    # As stiff, but a little more so while they are far apart: 6e-4 radians; 1.5e-2 without the
    # correction of the stiffness.
    np.testing.assert_allclose(ends[0], ends[1], rtol=0, atol=1e-3)


def test_a_coupling_with_other_parts_keeps_its_ratio() -> None:
    joints = '<joint joint="a" coef="2"/><joint joint="b" coef="-0.5"/>'
    model = mujoco.MjModel.from_xml_string(_TENDONS.format(joints=joints))
    enable_sleep(model)
    assert model.opt.enableflags & _SLEEP
    data = mujoco.MjData(model)
    data.qpos[:2] = 0.1, 0.4
    mujoco.mj_forward(model, data)
    # 2 * 0.1 - 0.5 * 0.4 in floating point.
    np.testing.assert_allclose(data.efc_pos[: data.ne], 0.0, atol=1e-12)


def test_tendons_that_couple_more_than_two_joints_are_refused() -> None:
    joints = "".join(f'<joint joint="{name}" coef="1"/>' for name in "abc")
    model = mujoco.MjModel.from_xml_string(_TENDONS.format(joints=joints))
    with pytest.raises(ValueError, match=r"equality 0 .* plan without Settings\(sleep=True\)"):
        enable_sleep(model)
    assert not model.opt.enableflags & _SLEEP
