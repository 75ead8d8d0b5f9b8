"""Fields bound late have the same values as fields bound from the start."""

import ctypes

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import lazy_batch
from limberjack.planner.history import History
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import scale

_NUM_ENVS = 3
_READ_BY_ITS_TASK = "torso_subtreelinvel"
_WORLD = """
<mujoco>
  <worldbody>
    <body name="arm">
      <joint name="hinge" type="hinge" axis="0 1 0"/>
      <geom size=".1" pos=".3 0 0"/>
      <site name="tip" pos=".3 0 0"/>
    </body>
  </worldbody>
  <sensor>
    <framelinvel objtype="site" objname="tip"/>
    <accelerometer site="tip"/>
    {more}
  </sensor>
</mujoco>
"""


def _walkers(bound: str | None = None) -> BatchEnvironment:
    """A batch, optionally with one field bound from the start."""
    batch = suite.load_batch("humanoid", "walk", _NUM_ENVS, 2, seed=1)
    if bound is not None:
        getattr(batch.physics.data, bound)
    batch.reset()
    return batch


def _actions(batch: BatchEnvironment, count: int) -> np.ndarray:
    return np.random.RandomState(2).uniform(-1, 1, (count, *batch.action_spec().shape))


def _disabled(batch: BatchEnvironment) -> list[str]:
    """Names of the disabled sensors."""
    model = batch.physics.model
    return [
        model.id2name(i, "sensor") for i in np.flatnonzero(batch.physics.simulation._lazy._disabled)
    ]


def _step(action: np.ndarray, *batches: BatchEnvironment) -> None:
    for batch in batches:
        batch.step(action)
    first, *others = [batch.physics.data.state for batch in batches]
    for other in others:
        np.testing.assert_array_equal(other, first)


@pytest.mark.usefixtures("share")
def test_sensors_are_disabled_until_they_are_read_by_name_or_all() -> None:
    batch = _walkers()
    before = _disabled(batch)
    assert len(before) == 31
    lazy = batch.physics.simulation._lazy
    stages, disabled = lazy.official.expand("sensor_needstage"), lazy._disabled
    assert (stages[:, disabled] == mujoco.mjtStage.mjSTAGE_NONE.value).all()
    assert (stages[:, ~disabled] != mujoco.mjtStage.mjSTAGE_NONE.value).all()
    assert _READ_BY_ITS_TASK not in before
    physics = batch.physics
    physics.named.data.sensordata["torso_accel"]
    physics.named.data.sensordata[["left_hand_touch", "right_hand_touch"]]
    enabled = {"torso_accel", "left_hand_touch", "right_hand_touch"}
    assert set(before) - set(_disabled(batch)) == enabled
    physics.named.data.sensordata[:3]
    assert (
        set(before) - set(_disabled(batch)) == enabled
    )  # the three belong to what was never disabled
    np.asarray(physics.named.data.sensordata)
    assert not _disabled(batch)


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("name", lazy_batch._OF_SENSORS)
def test_a_field_that_is_bound_late_is_as_if_bound_early(name: str) -> None:
    late, early = _walkers(), _walkers(name)
    assert not _disabled(early)
    for number, action in enumerate(_actions(late, 40)):
        _step(action, late, early)
        if number == 34:  # they have fallen
            late.reset([1])
            early.reset([1])
            assert _disabled(late)
        if number >= 34:
            values = getattr(early.physics.data, name)
            assert np.abs(values).max() > 1
            np.testing.assert_array_equal(getattr(late.physics.data, name), values)


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("task", suite.ALL_TASKS, ids="-".join)
def test_a_sensor_that_is_read_late_is_the_single_environments(task: tuple[str, str]) -> None:
    batch = suite.load_batch(*task, _NUM_ENVS, 2, seed=1)
    singles = [suite.load(*task, {"random": 1 + row}) for row in range(_NUM_ENVS)]
    batch.reset()
    for single in singles:
        single.reset()
    names = singles[0].physics.named.data.sensordata.axes.row.names
    for name, action in zip([*names[-4:], *names[:4]], _actions(batch, 8), strict=False):
        batch.step(action)
        for row, single in enumerate(singles):
            single.step(action[row])
            read = batch.physics.named.data.sensordata[name][row]
            np.testing.assert_array_equal(read, single.physics.named.data.sensordata[name], name)


@pytest.mark.usefixtures("share")
def test_after_a_snapshot_readings_are_those_that_were_saved() -> None:
    source, target = _walkers(), _walkers()
    first, second, third = _actions(source, 3)
    _step(first, source, target)
    snapshot = source.snapshot([0, 1])
    readings = source.physics.data.sensordata.copy()
    target.step(second)
    target.restore(snapshot, [1, 2])
    assert _disabled(target)
    target.physics.named.data.sensordata["torso_accel"]
    np.testing.assert_array_equal(target.physics.data.sensordata[1:], readings[:2])
    target.step(third)
    source.step(np.roll(third, -1, axis=0))
    after = source.physics.data.sensordata
    np.testing.assert_array_equal(target.physics.data.sensordata[1:], after[:2])


@pytest.mark.usefixtures("share")
def test_binding_a_field_after_a_row_has_diverged_changes_nothing_else() -> None:
    late, early = _walkers(), _walkers("sensordata")
    for batch in (late, early):
        batch.physics.data.qvel[1] = 1e9
        batch.step(np.zeros(batch.action_spec().shape))
        assert batch.diverged.tolist() == [False, True, False]
    counted = late.physics.simulation.warnings.copy()
    np.testing.assert_array_equal(late.physics.data.sensordata, early.physics.data.sensordata)
    np.testing.assert_array_equal(late.physics.simulation.warnings, counted)
    for action in _actions(late, 3):
        _step(action, late, early)
        np.testing.assert_array_equal(late.physics.data.sensordata, early.physics.data.sensordata)


def test_a_history_knows_readings_that_were_not_computed() -> None:
    physics, other = _walkers().physics, _walkers("sensordata").physics
    history = History(physics.simulation, 2)
    seen = physics.seen_through(history)

    def read() -> np.ndarray:
        history.begin()
        for moment in range(2):
            for one in (physics, other):
                one.step(5)
            history.record(moment)
        return seen.named.data.sensordata["torso_accel"]

    seen.named.data.sensordata[_READ_BY_ITS_TASK]
    read()
    assert not history.is_complete
    read()
    assert history.is_complete
    last = seen.named.data.sensordata["torso_accel"][_NUM_ENVS:]
    np.testing.assert_array_equal(last, other.named.data.sensordata["torso_accel"])


def _model(more: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_WORLD.format(more=more))


def test_sensors_that_can_be_disabled() -> None:
    model = _model('<jointactuatorfrc joint="hinge"/><clock/><touch site="tip"/><user dim="1"/>')
    expected = [False, True, True, False, True, False]
    assert lazy_batch._can_be_disabled(model, ()).tolist() == expected
    assert lazy_batch._can_be_disabled(model, ["geom_friction"]).tolist() == expected
    assert not lazy_batch._can_be_disabled(model, ["sensor_cutoff"]).any()


@pytest.mark.parametrize("how", ['delay=".01" nsample="6"', 'interval=".01 0" nsample="2"'])
def test_no_sensor_is_disabled_where_readings_are_remembered(how: str) -> None:
    assert not lazy_batch._can_be_disabled(_model(f'<force site="tip" {how}/>'), ()).any()


def test_no_sensor_is_disabled_beside_a_callback() -> None:
    callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda model, data: None)
    try:
        mujoco.set_mjcb_control(callback)
        assert not lazy_batch._can_be_disabled(_model(), ()).any()
    finally:
        mujoco.set_mjcb_control(None)
    assert lazy_batch._can_be_disabled(_model(), ()).any()


@pytest.mark.usefixtures("share")
def test_a_field_that_is_bound_late_leaves_the_warnings_alone() -> None:
    simulation = _walkers().physics.simulation
    simulation.state[1, 1] = np.nan
    simulation.step(1)
    assert simulation.has_warned()
    simulation.warnings[...] = 0
    simulation.data_field("qfrc_bias")
    assert not simulation.has_warned()


@pytest.mark.usefixtures("share")
def test_a_field_that_is_bound_late_leaves_loaded_readings_alone() -> None:
    simulation = _walkers().physics.simulation
    saved = simulation.save(np.array([1]), ())
    loaded = {"state": saved["state"], "sensordata": saved["sensordata"] + 1}
    simulation.load(loaded, np.array([1]))
    simulation.data_field("qfrc_bias")
    readings, _ = simulation.data_field("sensordata")
    np.testing.assert_array_equal(readings[1, None], loaded["sensordata"])


@pytest.mark.usefixtures("share")
def test_loading_a_row_that_has_diverged_leaves_the_warnings_alone() -> None:
    simulation = _walkers().physics.simulation
    simulation.state[1, 1] = np.nan
    simulation.step(1)
    assert simulation.has_warned()
    saved = simulation.save(np.array([1]), ())
    simulation.warnings[...] = 0
    simulation.load(saved, np.array([1]))  # repeats the step that diverged
    assert not simulation.has_warned()


@pytest.mark.usefixtures("share")
def test_loading_restores_states_that_were_written_after_the_last_call() -> None:
    batch = _walkers()
    simulation = batch.physics.simulation
    batch.step(_actions(batch, 1)[0])
    batch.physics.data.qpos[1, 2] += 0.5
    saved = simulation.save(np.array([1]), ())
    simulation.load(saved, np.array([0]))
    np.testing.assert_array_equal(simulation.state[0], simulation.state[1])


@pytest.mark.usefixtures("share")
def test_a_batch_made_again_has_every_quantity_and_constant() -> None:
    masses = {"body_mass": scale(0.5, 2.0)}
    batch = suite.load_batch(
        "humanoid", "walk", _NUM_ENVS, 2, seed=1, environment_kwargs={"randomize": masses}
    )
    batch.reset()
    batch.step(_actions(batch, 1)[0])
    lazy = batch.physics.simulation._lazy
    new = lazy.made_again(sets_constants=True)
    for name in ("xpos", "qfrc_bias", "subtree_com"):
        np.testing.assert_array_equal(new.field(name), lazy.field(name))
    for name in ("body_mass", "body_subtreemass", "dof_invweight0"):
        expected, found = lazy.official.expand(name), new.official.expand(name)
        np.testing.assert_array_equal(found, expected)
        assert (found[0] != found[1]).any()


def test_every_callback_of_this_mujoco_is_looked_at() -> None:
    names = "act_bias act_dyn act_gain contactfilter control passive sensor time"
    assert list(lazy_batch._CALLBACKS) == [f"mjcb_{name}" for name in names.split()]
    lazy_batch.check_callbacks()
