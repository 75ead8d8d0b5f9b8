"""Sensors that rest until somebody asks read what they would always have read."""

import ctypes

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import sensors
from limberjack.mujoco.history import History
from limberjack.rl.batch import BatchEnvironment

_NUM_ENVS = 3
_ASKED_BY_ITS_TASK = "torso_subtreelinvel"
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


def _walkers(asked: str | None = None) -> BatchEnvironment:
    """A batch; if so, one of which a field has been asked for from the beginning."""
    batch = suite.load_batch("humanoid", "walk", _NUM_ENVS, 2, seed=1)
    if asked is not None:
        getattr(batch.physics.data, asked)
    batch.reset()
    return batch


def _actions(batch: BatchEnvironment, count: int) -> np.ndarray:
    return np.random.RandomState(2).uniform(-1, 1, (count, *batch.action_spec().shape))


def _resting(batch: BatchEnvironment) -> list[str]:
    """The names of the sensors that rest."""
    model = batch.physics.model
    return [model.id2name(i, "sensor") for i in np.flatnonzero(batch.physics._simulation._resting)]


def _step(action: np.ndarray, *batches: BatchEnvironment) -> None:
    for batch in batches:
        batch.step(action)
    first, *others = [batch.physics.data.state for batch in batches]
    for other in others:
        np.testing.assert_array_equal(other, first)


@pytest.mark.usefixtures("share")
def test_what_nobody_asks_for_rests_and_what_is_asked_for_wakes_alone() -> None:
    batch = _walkers()
    before = _resting(batch)
    assert len(before) == 31
    assert _ASKED_BY_ITS_TASK not in before
    physics = batch.physics
    physics.named.data.sensordata["torso_accel"]
    physics.named.data.sensordata[["left_hand_touch", "right_hand_touch"]]
    woken = {"torso_accel", "left_hand_touch", "right_hand_touch"}
    assert set(before) - set(_resting(batch)) == woken
    physics.named.data.sensordata[:3]
    assert set(before) - set(_resting(batch)) == woken  # the three belong to what was never resting
    np.asarray(physics.named.data.sensordata)
    assert not _resting(batch)


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("name", sensors.FIELDS)
def test_a_field_that_is_asked_for_late_is_as_if_asked_for_early(name: str) -> None:
    late, early = _walkers(), _walkers(name)
    assert not _resting(early)
    for number, action in enumerate(_actions(late, 40)):
        _step(action, late, early)
        if number == 34:  # they have fallen
            late.reset([1])
            early.reset([1])
            assert _resting(late)
        if number >= 34:
            values = getattr(early.physics.data, name)
            assert np.abs(values).max() > 1
            np.testing.assert_array_equal(getattr(late.physics.data, name), values)


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("task", suite.ALL_TASKS, ids="-".join)
def test_a_name_that_is_asked_for_late_is_the_single_environments(task: tuple[str, str]) -> None:
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
    assert _resting(target)
    target.physics.named.data.sensordata["torso_accel"]
    np.testing.assert_array_equal(target.physics.data.sensordata[1:], readings[:2])
    target.step(third)
    source.step(np.roll(third, -1, axis=0))
    after = source.physics.data.sensordata
    np.testing.assert_array_equal(target.physics.data.sensordata[1:], after[:2])


@pytest.mark.usefixtures("share")
def test_asking_after_a_row_has_diverged_changes_nothing_else() -> None:
    late, early = _walkers(), _walkers("sensordata")
    for batch in (late, early):
        batch.physics.data.qvel[1] = 1e9
        batch.step(np.zeros(batch.action_spec().shape))
        assert batch.diverged.tolist() == [False, True, False]
    counted = late.physics._simulation.warnings.copy()
    np.testing.assert_array_equal(late.physics.data.sensordata, early.physics.data.sensordata)
    np.testing.assert_array_equal(late.physics._simulation.warnings, counted)
    for action in _actions(late, 3):
        _step(action, late, early)
        np.testing.assert_array_equal(late.physics.data.sensordata, early.physics.data.sensordata)


def test_a_history_says_that_readings_are_missing_which_were_not_computed() -> None:
    physics, other = _walkers().physics, _walkers("sensordata").physics
    history = History(physics, 2)
    seen = physics.seen_through(history)

    def read() -> np.ndarray:
        history.begin()
        for moment in range(2):
            for one in (physics, other):
                one.step_rows(None, 5)
            history.note(moment)
        return seen.named.data.sensordata["torso_accel"]

    seen.named.data.sensordata[_ASKED_BY_ITS_TASK]
    read()
    assert not history.is_complete
    read()
    assert history.is_complete
    last = seen.named.data.sensordata["torso_accel"][_NUM_ENVS:]
    np.testing.assert_array_equal(last, other.named.data.sensordata["torso_accel"])


def _model(more: str = "") -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_WORLD.format(more=more))


def test_which_may_rest() -> None:
    model = _model('<jointactuatorfrc joint="hinge"/><clock/><touch site="tip"/><user dim="1"/>')
    expected = [False, True, True, False, True, False]
    assert sensors.may_rest(model).tolist() == expected
    assert sensors.may_rest(model, ["geom_friction"]).tolist() == expected
    assert not sensors.may_rest(model, ["sensor_cutoff"]).any()


@pytest.mark.parametrize("how", ['delay=".01" nsample="6"', 'interval=".01 0" nsample="2"'])
def test_none_rests_where_readings_are_remembered(how: str) -> None:
    assert not sensors.may_rest(_model(f'<force site="tip" {how}/>')).any()


def test_none_rests_beside_a_callback() -> None:
    callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda model, data: None)
    try:
        mujoco.set_mjcb_control(callback)
        assert not sensors.may_rest(_model()).any()
    finally:
        mujoco.set_mjcb_control(None)
    assert sensors.may_rest(_model()).any()
