"""The state of a physics as one array, of one simulation and of a batch."""

from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Physics

_XML = """
<mujoco>
  <worldbody><body><joint name="hinge"/><geom size=".1" pos=".5 0 0"/></body></worldbody>
  <actuator><general joint="hinge" dyntype="filter" dynprm=".1"/></actuator>
</mujoco>
"""
_VELOCITY = mujoco.mjtState.mjSTATE_QVEL.value
_WARM_START = mujoco.mjtState.mjSTATE_WARMSTART.value


def test_the_state_is_positions_velocities_and_activations() -> None:
    physics = Physics.from_xml_string(_XML)
    physics.set_state(np.array([0.1, 0.2, 0.3]))
    assert (physics.data.qpos[0], physics.data.qvel[0], physics.data.act[0]) == (0.1, 0.2, 0.3)
    assert physics.get_state().tolist() == physics.state().tolist() == [0.1, 0.2, 0.3]


def test_a_batch_has_a_row_for_each_simulation() -> None:
    batch = Physics.from_xml_string(_XML).replicate(2, 1).physics
    state = np.arange(6.0).reshape(2, 3)
    batch.set_state(state)
    np.testing.assert_array_equal(batch.get_state(), state)
    np.testing.assert_array_equal(batch.get_state(_VELOCITY), state[:, 1:2])
    batch.set_state(np.array([[7.0], [8.0]]), _VELOCITY)
    np.testing.assert_array_equal(batch.data.qvel, [[7.0], [8.0]])
    assert batch.get_state(_WARM_START).shape == (2, 1)


@pytest.mark.parametrize("shape", [(2,), (4,), (1, 3)])
def test_a_state_of_another_shape_is_refused_and_changes_nothing(shape: tuple[int, ...]) -> None:
    physics = Physics.from_xml_string(_XML)
    with pytest.raises(ValueError, match=r"Expected \(3,\)"):
        physics.set_state(np.ones(shape))
    assert not physics.get_state().any()


@pytest.mark.parametrize("rows", [None, 2])
@pytest.mark.parametrize("sig", [-1, 2**15, 2**31, 2**70, 1.5, "qpos", [1]])
def test_unknown_parts_of_a_state_are_refused(sig: Any, rows: int | None) -> None:
    physics = Physics.from_xml_string(_XML)
    if rows is not None:
        physics = physics.replicate(rows, 1).physics
    for use in (physics.get_state, lambda sig: physics.set_state(np.ones(3), sig)):
        with pytest.raises((ValueError, TypeError), match=r"sig is .*; expected bits of mujoco"):
            use(sig)
    assert not physics.get_state().any()


def test_parts_of_a_state_are_bits_or_their_names() -> None:
    physics = Physics.from_xml_string(_XML)
    assert physics.get_state(0).shape == (0,)
    assert physics.get_state(np.int64(_VELOCITY)).shape == (1,)  # pyright: ignore[reportArgumentType]
    assert physics.get_state(mujoco.mjtState.mjSTATE_QVEL).shape == (1,)  # pyright: ignore[reportArgumentType]
    whole = 2**mujoco.mjtState.mjNSTATE.value - 1
    physics.set_state(physics.get_state(whole), whole)


def test_a_subclass_may_name_other_parts_of_the_state() -> None:
    class Positions(Physics):
        def _physics_state_items(self) -> list[np.ndarray]:
            return [self.data.qpos]

    physics = Positions.from_xml_string(_XML)
    physics.set_state(np.array([0.5]))
    assert physics.get_state().tolist() == [0.5]
