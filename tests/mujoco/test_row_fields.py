"""Fields of rows are live, whether MuJoCo's batch holds them or each row has a model."""

from typing import Any

import mujoco
import mujoco.batch
import numpy as np
import pytest

from limberjack.mujoco import Physics, row_fields
from limberjack.mujoco.batch_simulation import BatchSimulation

_XML = """
<mujoco>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" width="128" height="768"/>
    <hfield name="hill" nrow="2" ncol="2" size="1 1 1 .1"/>
  </asset>
  <worldbody>
    <geom name="hill" type="hfield" hfield="hill"/>
    <body name="ball" pos=".3 0 1.2">
      <freejoint/>
      <geom size=".1"/>
      <site name="eye" zaxis="0 0 -1"/>
    </body>
    <body><joint name="hinge"/><geom size=".1" pos="3 0 5"/></body>
  </worldbody>
  <actuator><motor joint="hinge" ctrlrange="-1 1"/></actuator>
  <sensor><rangefinder site="eye"/><accelerometer name="accel" site="eye"/></sensor>
</mujoco>
"""
_NUM_ENVS = 4
_OWN = {
    "expanded": ("body_mass", "opt.gravity"),
    "models": ("hfield_data", "body_mass", "opt.gravity"),
}


@pytest.fixture(params=_OWN)
def rows(request: pytest.FixtureRequest) -> BatchSimulation:
    model = Physics.from_xml_string(_XML).model
    return BatchSimulation(model, _NUM_ENVS, 2, _OWN[request.param])


@pytest.fixture
def of_models() -> BatchSimulation:
    return BatchSimulation(Physics.from_xml_string(_XML).model, _NUM_ENVS, 2, _OWN["models"])


def test_models_are_used_only_where_the_batch_cannot_hold_a_field() -> None:
    model = mujoco.MjModel.from_xml_string(_XML)
    for names, kind in (
        (("body_mass",), row_fields.Expanded),
        (("hfield_data",), row_fields.RowModels),
    ):
        batch = mujoco.batch.Batch(model, 2, 1)
        assert type(row_fields.of(batch, model, 2, names)) is kind
        assert (batch.models is None) == (kind is row_fields.Expanded)


def test_rows_are_read_and_written_as_in_an_array(rows: BatchSimulation) -> None:
    expected = np.tile(rows.model._official.body_mass, (_NUM_ENVS, 1))
    own = rows.own_fields["body_mass"]
    for index in (2, slice(1, 3), np.array([0, 3]), np.array([True, False, False, True]), ...):
        value = np.random.RandomState(0).uniform(1, 2, expected[index].shape)
        expected[index] = own[index] = value
        np.testing.assert_array_equal(own[index], value)
        np.testing.assert_array_equal(own[:], expected)
        np.testing.assert_array_equal(rows.model_field("body_mass")[0], expected)
    np.testing.assert_array_equal(own[np.array([], int)], expected[:0])


def test_an_option_that_is_one_number_is_read_and_written_by_rows() -> None:
    model = Physics.from_xml_string(_XML).model
    rows = BatchSimulation(model, _NUM_ENVS, 1, ("hfield_data", "opt.viscosity"))
    own = rows.own_fields["opt.viscosity"]
    own[1:] = np.array([1.0, 2.0, 3.0])
    assert own[:].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert own[2] == 2.0
    saved = rows.save(np.array([1, 3]), ("opt.viscosity",))
    assert saved["opt.viscosity"].tolist() == [1.0, 3.0]


def _alone(rows: BatchSimulation, row: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """MuJoCo's own objects with a row's fields."""
    model = mujoco.MjModel.from_xml_string(_XML)
    for name, values in rows.own_fields.items():
        if name == "opt.gravity":
            model.opt.gravity = values[row]
        else:
            getattr(model, name)[...] = values[row]
    return model, mujoco.MjData(model)


def _vary(rows: BatchSimulation) -> None:
    random = np.random.RandomState(0)
    for row in range(_NUM_ENVS):
        drawn = {
            n: v[row] * random.uniform(0.5, 1, v[row].shape) for n, v in rows.own_fields.items()
        }
        if "hfield_data" in drawn:
            drawn["hfield_data"] = random.uniform(0, 0.5, 4)
        rows.set_fields(drawn, row)


def test_each_row_steps_on_its_own_fields(rows: BatchSimulation) -> None:
    _vary(rows)
    rows.forward_without_actuation()
    rows.step(200)
    readings = rows.data_field("sensordata")[0]
    for row in range(_NUM_ENVS):
        model, data = _alone(rows, row)
        mujoco.mj_forward(model, data)
        mujoco.mj_step(model, data, 200)
        mujoco.mj_step1(model, data)
        np.testing.assert_array_equal(rows.data_field("qpos")[0][row], data.qpos)
        np.testing.assert_array_equal(readings[row], data.sensordata)
    assert len(np.unique(rows.data_field("qpos")[0][:, 2])) == _NUM_ENVS


def test_a_start_disables_actuation_only_while_it_runs(rows: BatchSimulation) -> None:
    force = rows.data_field("qfrc_actuator")[0]
    rows.ctrl[:] = 1
    rows.forward()
    assert force.any(axis=-1).all()
    rows.forward_without_actuation(np.array([1, 3]))
    assert force.any(axis=-1).tolist() == [True, False, True, False]
    rows.forward()
    assert force.any(axis=-1).all()


def test_a_start_that_is_interrupted_leaves_actuation_to_the_next_call(
    rows: BatchSimulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(rows._fields, "restore_actuation", interrupted)
        with pytest.raises(KeyboardInterrupt):
            rows.forward_without_actuation()
    rows.ctrl[:] = 1
    rows.forward()
    assert (rows.data_field("actuator_force")[0] == 1).all()


def test_constants_of_a_row_follow_its_fields(rows: BatchSimulation) -> None:
    rows.sets_constants = True
    _vary(rows)
    rows.step(3)
    for row in range(_NUM_ENVS):
        model, data = _alone(rows, row)
        mujoco.mj_setConst(model, data)
        official = rows._official.get_model(row)
        np.testing.assert_array_equal(official.body_subtreemass, model.body_subtreemass)
        np.testing.assert_array_equal(official.dof_invweight0, model.dof_invweight0)


def test_a_batch_made_again_steps_alike(rows: BatchSimulation) -> None:
    _vary(rows)
    rows.forward_without_actuation()
    before, fields = rows.save(None, ()), dict(rows.own_fields)
    rows.step(50)
    expected = rows.state.copy()
    rows.load(before)
    rows.abandon()  # as in a forked child
    for name, values in rows.own_fields.items():
        assert values is not fields[name]
        np.testing.assert_array_equal(values[:], fields[name][:])
    rows.step(50)
    np.testing.assert_array_equal(rows.state, expected)


def test_models_of_rows_have_no_textures_and_only_they_are_changed(
    of_models: BatchSimulation,
) -> None:
    _vary(of_models)
    models: Any = of_models._official.models
    assert len(models) == len({id(model) for model in models}) == _NUM_ENVS
    assert not any(model.ntexdata for model in models)
    assert not of_models.model._official.hfield_data.any()


def test_fields_of_rows_with_models_are_current_and_read_only(of_models: BatchSimulation) -> None:
    physics = Physics.from_xml_string(_XML).seen_through(of_models)
    masses, named = physics.model.body_mass, physics.named.model.body_mass
    _vary(of_models)
    for row in range(_NUM_ENVS):
        expected = of_models.own_fields["body_mass"][row]
        np.testing.assert_array_equal(masses[row], expected)
        assert named["ball"][row] == expected[1]
    for write in (masses.fill, lambda value: named.__setitem__("ball", value)):
        with pytest.raises(ValueError, match="read-only"):
            write(3.0)
    with pytest.raises(ValueError, match=r"body_mass of the model is read-only, since each row"):
        physics.model.body_mass = 3.0
