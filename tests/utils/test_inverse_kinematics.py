"""Tests of limberjack.utils.inverse_kinematics; tests/oracle compares it with dm_control."""

import logging
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics, wrapper
from limberjack.utils import inverse_kinematics as ik

_ARM = """
<mujoco>
  <worldbody>
    <body><joint name="pan" axis="0 0 1"/><geom size=".05"/>
      <body pos="0 0 .2"><joint name="shoulder" axis="0 1 0"/><geom size=".05"/>
        <body pos=".3 0 0"><joint name="elbow" axis="0 1 0"/><geom size=".05"/>
          <body pos=".3 0 0"><joint name="wrist" type="ball"/><geom size=".05"/>
            <site name="tip" pos=".1 0 0"/>
          </body>
        </body>
      </body>
    </body>
    <body pos="2 0 0"><freejoint name="crate"/><geom size=".1"/>
      <site name="lid" pos="0 0 .1"/>
    </body>
  </worldbody>
</mujoco>
"""
_TARGET = np.array([0.3, 0.2, 0.4])
_TURN = np.array([0.8, 0.0, 0.6, 0.0])


@pytest.fixture
def physics() -> Physics:
    physics = Physics.from_xml_string(_ARM)
    with physics.reset_context():
        physics.named.data.qpos["elbow"] = 0.5
    return physics


def _pose(physics: Physics, qpos: np.ndarray, site: str) -> tuple[np.ndarray, np.ndarray]:
    """Position and orientation of a site at the given joint positions."""
    physics = physics.copy()
    physics.data.qpos[:] = qpos
    physics.forward()
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, physics.named.data.site_xmat[site])
    return physics.named.data.site_xpos[site].copy(), quat


@pytest.mark.parametrize("form", [np.array, list, tuple])
def test_the_site_reaches_a_position(physics: Physics, form: Any) -> None:
    result = ik.qpos_from_site_pose(physics, "tip", target_pos=form(_TARGET))
    assert result.success
    assert 0 < result.steps < 100
    assert result.err_norm < 1e-14
    position, _ = _pose(physics, result.qpos, "tip")
    np.testing.assert_allclose(position, _TARGET, atol=1e-12)


@pytest.mark.parametrize("position", [None, _TARGET])
@pytest.mark.parametrize("site", ["tip", "lid"])
def test_the_site_reaches_an_orientation_and_a_pose(
    physics: Physics, position: np.ndarray | None, site: str
) -> None:
    result = ik.qpos_from_site_pose(physics, site, position, _TURN, tol=1e-10)
    assert result.success
    reached, quat = _pose(physics, result.qpos, site)
    np.testing.assert_allclose(abs(quat @ _TURN), 1, atol=1e-12)
    if position is not None:
        np.testing.assert_allclose(reached, position, atol=1e-9)


@pytest.mark.parametrize("names", [["wrist", "elbow"], ("elbow", "wrist"), np.array(["elbow"])])
def test_only_the_named_joints_move(physics: Physics, names: Any) -> None:
    before = physics.position()
    result = ik.qpos_from_site_pose(physics, "tip", _TARGET, joint_names=names)
    still = [
        joint for joint in ("pan", "shoulder", "crate", "elbow", "wrist") if joint not in names
    ]
    axis = physics.named.data.qpos.axes.row
    for joint in still:
        index = axis.convert_key_item(joint)
        np.testing.assert_array_equal(result.qpos[index], before[index])
    elbow = axis.convert_key_item("elbow")
    assert np.all(result.qpos[elbow] != before[elbow])


def test_by_default_the_simulation_stays_as_it_was(physics: Physics) -> None:
    physics.data.qpos[0] = 0.1  # derived quantities are now out of date, and stay so
    arrays = ("qpos", "qvel", "xpos", "site_xpos", "qacc", "qacc_warmstart", "sensordata")
    before = {name: getattr(physics.data, name).copy() for name in arrays}
    result = ik.qpos_from_site_pose(physics, "tip", _TARGET)
    assert result.success
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(physics.data, name), value)
    kept = result.qpos.copy()
    physics.step()
    np.testing.assert_array_equal(result.qpos, kept)


def test_in_place_the_simulation_moves_and_the_result_is_live(physics: Physics) -> None:
    expected = ik.qpos_from_site_pose(physics, "tip", _TARGET)
    result = ik.qpos_from_site_pose(physics, "tip", _TARGET, inplace=True)
    np.testing.assert_array_equal(result.qpos, expected.qpos)
    assert np.shares_memory(result.qpos, physics.data.qpos)
    np.testing.assert_allclose(physics.named.data.site_xpos["tip"], _TARGET, atol=1e-12)


def test_a_target_out_of_reach_ends_without_success(
    physics: Physics, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, logger="limberjack"):
        result = ik.qpos_from_site_pose(
            physics, "tip", [9, 0, 0], progress_thresh=np.inf, max_steps=7
        )
    assert not result.success
    assert result.steps == 6
    assert result.err_norm > 8
    assert "did not converge in 7 steps" in caplog.text
    stuck = ik.qpos_from_site_pose(physics, "tip", [9, 0, 0], progress_thresh=0.1)
    assert (stuck.success, stuck.steps) == (False, 0)


def test_a_site_that_no_joint_moves_ends_the_search_without_a_warning(physics: Physics) -> None:
    result = ik.qpos_from_site_pose(physics, "lid", [1, 2, 3], joint_names=["pan"])
    assert (result.success, result.steps) == (False, 0)


def test_a_model_that_is_shared_stays_shared() -> None:
    physics = suite.load("manipulator", "bring_ball", {"random": 0}).physics
    assert physics.model._shared is not None
    result = ik.qpos_from_site_pose(physics, "grasp", [0.2, 0, 0.4], joint_names=["arm_root"])
    assert np.isfinite(result.err_norm)
    assert physics.model._shared is not None


@pytest.mark.parametrize(
    ("arguments", "kind", "message"),
    [
        ({}, ValueError, "target_pos and target_quat are both None"),
        ({"target_pos": [1, 2]}, ValueError, r"target_pos has shape \(2,\); expected \(3,\)"),
        ({"target_quat": [1, 2]}, TypeError, r"target_quat is \[1, 2\]; expected a quaternion"),
        ({"target_pos": _TARGET, "site_name": "tipp"}, wrapper.Error, "Did you mean 'tip'"),
        ({"target_pos": _TARGET, "site_name": None}, TypeError, "name is None; expected"),
        ({"target_pos": _TARGET, "joint_names": "pan"}, ValueError, "'str'>; expected None for"),
        ({"target_pos": _TARGET, "joint_names": ["pam"]}, KeyError, "Did you mean 'pan'"),
        ({"target_pos": _TARGET, "joint_names": []}, ValueError, "at least one name"),
        ({"target_pos": _TARGET, "max_steps": 0}, ValueError, "max_steps is 0; expected at"),
        ({"target_pos": _TARGET, "max_steps": 2.5}, TypeError, "float"),
    ],
)
@pytest.mark.parametrize("inplace", [False, True])
def test_a_refused_search_changes_nothing(
    physics: Physics, arguments: dict[str, Any], kind: type[Exception], message: str, inplace: bool
) -> None:
    physics.data.qpos[0] = 0.1
    before = physics.data.xpos.copy()
    with pytest.raises(kind, match=message):
        ik.qpos_from_site_pose(
            **{"physics": physics, "site_name": "tip", **arguments}, inplace=inplace
        )
    np.testing.assert_array_equal(physics.data.xpos, before)
    assert physics.data.qpos[0] == 0.1


@pytest.mark.parametrize("inplace", [False, True])
def test_a_batch_is_refused(inplace: bool) -> None:
    env = suite.load_batch("manipulator", "bring_ball", num_envs=2, seed=0)
    with pytest.raises(TypeError, match="physics is a batch; expected one simulation"):
        ik.qpos_from_site_pose(env.physics, "grasp", np.ones(3), inplace=inplace)


def test_the_nullspace_method_finds_the_least_displacement() -> None:
    jacobian = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 2.0]])
    np.testing.assert_allclose(ik.nullspace_method(jacobian, np.array([2.0, 4.0])), [1, 1, 2])
    damped = ik.nullspace_method(jacobian, np.array([2.0, 4.0]), regularization_strength=1.0)
    np.testing.assert_allclose(damped, [2 / 3, 2 / 3, 8 / 5])
