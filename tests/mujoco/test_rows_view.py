"""`physics.data` and `physics.model` of a batch: MuJoCo's fields with one row per simulation."""

import copy
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Physics, rows_view
from limberjack.mujoco.rows_view import RowsData, RowsModel
from limberjack.mujoco.wrapper import MjModel

_NUM_ENVS = 3
_XML = """
<mujoco model="pole">
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="pole">
      <joint name="hinge" axis="0 1 0"/><geom name="rod" size=".1" pos=".5 0 0"/>
    </body>
  </worldbody>
  <actuator><motor joint="hinge"/></actuator>
</mujoco>
"""


# Any: a `RowsData` and its `RowsModel`, whose fields nothing lists.
@pytest.fixture
def data() -> Any:
    return Physics.from_xml_string(_XML).replicate(_NUM_ENVS, 1, ("body_mass",)).physics.data


@pytest.fixture
def model(data: Any) -> Any:
    return data.model


def test_fields_of_the_data_have_a_leading_axis(data: Any) -> None:
    assert isinstance(data, RowsData)
    shapes = {"qpos": (3, 1), "xpos": (3, 2, 3), "ctrl": (3, 1), "geom_xmat": (3, 2, 9)}
    assert {name: getattr(data, name).shape for name in shapes} == shapes
    assert data.time.shape == (_NUM_ENVS,)


def test_fields_are_the_same_live_arrays_each_time(data: Any) -> None:
    qpos = data.qpos
    data.qpos[1] = 0.5
    assert qpos is data.qpos
    assert qpos[:, 0].tolist() == [0.0, 0.5, 0.0]
    assert data._data is data


def test_assigning_a_field_writes_into_every_row(data: Any) -> None:
    qpos = data.qpos
    data.qpos = 0.25
    assert qpos is data.qpos
    assert qpos[:, 0].tolist() == [0.25] * _NUM_ENVS
    data.qpos = [[1.0], [2.0], [3.0]]
    assert qpos[:, 0].tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="broadcast"):
        data.qpos = np.zeros(5)


def test_an_unknown_field_of_the_data_is_an_attribute_error_with_advice(data: Any) -> None:
    with pytest.raises(AttributeError, match="data of a batch has no 'qops'; it has the arrays of"):
        _ = data.qops
    assert not hasattr(data, "ptr")
    with pytest.raises(AttributeError, match=r"no data.step\(...\): use the methods of physics"):
        data.step(nstep=5)
    with pytest.raises(AttributeError):
        data.qops = 1


@pytest.mark.parametrize("kind", [RowsData, RowsModel])
def test_an_uninitialised_view_has_no_fields_and_does_not_recurse(kind: Any) -> None:
    half: Any = kind.__new__(kind)
    with pytest.raises(AttributeError):
        _ = half.qpos
    assert not hasattr(half, "_fields")


def test_fields_of_the_model_have_an_axis_where_rows_have_their_own(model: Any) -> None:
    assert isinstance(model, RowsModel)
    assert model.body_mass.shape == (_NUM_ENVS, 2)
    assert model.geom_size.shape == (2, 3)
    assert (model.nq, model.nbody, model.name) == (1, 2, "pole")
    assert model.opt.gravity.shape == (3,)


def test_assigning_a_per_row_field_writes_into_it(model: Any) -> None:
    masses = model.body_mass
    model.body_mass = np.arange(6.0).reshape(3, 2)
    np.testing.assert_array_equal(masses, np.arange(6.0).reshape(3, 2))


@pytest.mark.parametrize(
    ("name", "value"), [("geom_size", 1.0), ("nq", 2), ("opt", None), ("body_parentid", 0)]
)
def test_fields_shared_by_rows_cannot_be_assigned(model: Any, name: str, value: object) -> None:
    before = copy.copy(model)
    with pytest.raises(ValueError, match=r"shared by all rows|read-only"):
        setattr(model, name, value)
    np.testing.assert_array_equal(model.geom_size, before.geom_size)


def test_structs_of_the_model_can_be_read_only(model: Any) -> None:
    assert model.opt.timestep == 0.002
    with pytest.raises(ValueError, match=r"opt\.timestep is shared by all rows"):
        model.opt.timestep = 0.1


def test_methods_of_the_official_model_are_refused_with_advice(model: Any) -> None:
    with pytest.raises(AttributeError, match=r"no model\.geom\(\.\.\.\): use physics\.named\.mod"):
        _ = model.geom


def test_names_of_objects_are_looked_up_as_in_a_single_simulation(model: Any) -> None:
    assert model.name2id("rod", "geom") == 1
    assert model.id2name(1, "body") == "pole"


def test_a_copy_is_an_ordinary_model_of_its_own(model: Any) -> None:
    copied = copy.copy(model)
    copied.geom_size[:] = 8.0
    assert type(copied) is MjModel
    assert model.geom_size[1, 0] == 0.1


@pytest.mark.parametrize(
    "source", [lambda: Physics.from_shared_xml(_XML, {}), lambda: Physics.from_xml_string(_XML)]
)
def test_the_official_model_is_a_copy_that_reaches_no_row(source: Any) -> None:
    rows = source().replicate(_NUM_ENVS, 1, ())
    rows.physics.model.ptr.opt.gravity[:] = 0.0
    rows.physics.model.ptr.geom_size[:] = 9.0
    assert rows.simulation.model.geom_size[1, 0] == 0.1
    assert rows.physics.model.geom_size[1, 0] == 0.1
    rows.step(None, 5)
    assert rows.physics.data.qvel.all()


_MOVING = """
<mujoco>
  <worldbody>
    <camera name="still" pos="0 -1 0"/>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <body name="base" pos="0 0 1">
      <freejoint/>
      <geom name="base" size=".1" pos=".1 .2 .3" euler="10 20 30"/>
      <body name="arm" pos=".3 0 0" euler="40 0 10">
        <joint axis="0 1 1"/>
        <geom name="arm" type="box" size=".1 .2 .05" pos="0 .1 0"/>
        <site name="tip" pos=".2 .1 0" euler="0 50 0"/>
        <camera name="eye" pos="0 0 .1" euler="30 0 0"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
_OBJECTS = [
    *((name, "body") for name in ("world", "base", "arm")),
    *(("arm", "xbody"), ("arm", "geom"), ("floor", "geom"), ("base", "geom"), (0, "site")),
    *(("eye", "camera"), ("still", "camera"), (2, mujoco.mjtObj.mjOBJ_BODY)),
]


@pytest.mark.parametrize("num_envs", [_NUM_ENVS, 200])  # few rows, and rows that share their data
@pytest.mark.parametrize("local_frame", [False, True])
def test_velocities_of_objects_are_those_of_single_simulations(
    num_envs: int, local_frame: bool
) -> None:
    single = Physics.from_xml_string(_MOVING)
    rows = single.replicate(num_envs, 1)
    rows.simulation.state[:, 1:] += np.random.RandomState(0).normal(
        size=rows.simulation.state[:, 1:].shape
    )
    rows.step(None, 2)
    for name, kind in _OBJECTS:
        found = rows.physics.data.object_velocity(name, kind, local_frame)
        assert found.shape == (num_envs, 2, 3)
        for row in range(_NUM_ENVS):
            expected = rows.shown(row).data.object_velocity(name, kind, local_frame)
            np.testing.assert_array_equal(found[row], expected)
            np.testing.assert_array_equal(np.signbit(found[row]), np.signbit(expected))


@pytest.mark.parametrize("local_frame", [False, True])
def test_the_formula_for_arrays_on_a_device_is_mujocos(local_frame: bool) -> None:
    rows = Physics.from_xml_string(_MOVING).replicate(_NUM_ENVS, 1)
    rows.simulation.state[:, 1:] += 0.5
    rows.step(None, 2)
    data = rows.physics.data
    tip = data.cvel[:, 2], data.subtree_com[:, 1], data.site_xpos[:, 0], data.site_xmat[:, 0]
    found = rows_view._velocity(*tip, local_frame=local_frame)
    # Rounded in another order where compilers fuse operations.
    expected = data.object_velocity("tip", "site", local_frame)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_the_velocity_of_something_else_is_refused(data: Any) -> None:
    with pytest.raises(ValueError, match="objects of type 'joint' have no velocity"):
        data.object_velocity("hinge", "joint")
    with pytest.raises(ValueError, match="object_id is 7"):
        data.object_velocity(7, "geom")


def test_an_option_that_differs_by_row_has_an_axis() -> None:
    physics = Physics.from_xml_string(_XML).replicate(_NUM_ENVS, 1, ("opt.gravity",)).physics
    options = physics.model.opt
    assert options.gravity.shape == (_NUM_ENVS, 3)
    assert options.wind.shape == (3,)
    with pytest.raises(ValueError, match=r"opt\.wind is shared"):
        options.wind[0] = 1.0
    options.gravity[1] = 0.0
    physics.simulation.step(1)
    velocity = physics.velocity()
    np.testing.assert_array_equal(velocity[2], velocity[0])
    assert (velocity[1] != velocity[0]).any()
    options.gravity = -9.0
    assert physics.model.opt.gravity.tolist() == [[-9.0] * 3] * _NUM_ENVS


def test_an_option_of_rows_with_models_of_their_own_has_their_values() -> None:
    own = "opt.gravity", "opt.viscosity", "skin_rgba"
    physics = Physics.from_xml_string(_XML).replicate(_NUM_ENVS, 1, own).physics
    physics.simulation.set_fields({"opt.viscosity": np.array(2.0)}, 1)
    options = physics.model.opt
    assert options.gravity[..., 2].tolist() == [-9.81] * _NUM_ENVS
    assert options.viscosity.tolist()[:2] == [0.0, 2.0]
    with pytest.raises(ValueError, match=r"opt\.gravity of the model is read-only"):
        options.gravity[0] = 1.0
