"""`action_spec`: the controls of a model's actuators."""

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics, action_spec

_MODEL = """
<mujoco>
  <worldbody>
    <body><joint name="hinge"/><joint name="slide" type="slide"/><geom size=".1"/></body>
  </worldbody>
  {actuators}
</mujoco>
"""
_ACTUATORS = """
<actuator>
  <motor joint="hinge" ctrllimited="true" ctrlrange="-2 3"/>
  <motor joint="slide"/>
  <motor joint="slide" ctrllimited="false" ctrlrange="-1 1"/>
</actuator>
"""


def _made(actuators: str) -> Physics:
    return Physics.from_xml_string(_MODEL.format(actuators=actuators))


def test_bounds_are_those_of_limited_actuators_and_else_mujocos_maximum() -> None:
    spec = action_spec(_made(_ACTUATORS))
    assert spec.shape == (3,)
    assert spec.dtype == float
    np.testing.assert_array_equal(spec.minimum, [-2.0, -mujoco.mjMAXVAL, -mujoco.mjMAXVAL])
    np.testing.assert_array_equal(spec.maximum, [3.0, mujoco.mjMAXVAL, mujoco.mjMAXVAL])


def test_a_model_without_actuators_takes_an_empty_action() -> None:
    spec = action_spec(_made(""))
    assert spec.shape == (0,)
    assert spec.generate_value().shape == (0,)


def test_bounds_that_are_edited_are_those_of_the_next_spec_alone() -> None:
    physics = _made(_ACTUATORS)
    before = action_spec(physics)
    physics.model.actuator_ctrlrange[0] = -0.5, 0.25
    after = action_spec(physics)
    assert (before.minimum[0], before.maximum[0]) == (-2.0, 3.0)
    assert (after.minimum[0], after.maximum[0]) == (-0.5, 0.25)


# Targets of the quadruped's joints have ranges of their own, and lqr has no limits.
_OTHER_LIMITS = ("lqr", "quadruped")


@pytest.mark.parametrize("task", suite.ALL_TASKS, ids="-".join)
def test_the_suites_actuators_are_limited_to_1_or_as_the_model_says(task: tuple[str, str]) -> None:
    physics = suite.load(*task).physics
    spec = action_spec(physics)
    assert spec.shape == (physics.model.nu,)
    limited = physics.model.actuator_ctrllimited.astype(bool)
    if task[0] in _OTHER_LIMITS:
        expected = np.where(
            limited[:, None], physics.model.actuator_ctrlrange, (-mujoco.mjMAXVAL, mujoco.mjMAXVAL)
        )
    else:
        expected = np.tile([-1.0, 1.0], (physics.model.nu, 1))
    np.testing.assert_array_equal(spec.minimum, expected[:, 0])
    np.testing.assert_array_equal(spec.maximum, expected[:, 1])
