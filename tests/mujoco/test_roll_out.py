"""Many time steps in one call are the same as one after the other."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite

_ROWS, _STEPS = 3, 12


def _physics(task: str = "bring_ball") -> Any:
    batch = suite.load_batch("manipulator", task, _ROWS, 2, seed=5)
    batch.reset()
    return batch.physics


def _controls() -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (_ROWS, _STEPS, 5))


@pytest.mark.usefixtures("share")
def test_records_and_the_end_are_those_of_single_steps() -> None:
    ours, other = _physics(), _physics()
    controls = _controls()
    fields = ["qpos", "time", "site_xpos", "actuator_force"]
    records, diverged = ours.roll_out(controls, fields)
    assert not diverged.any()
    for step in range(_STEPS):
        other.set_control(controls[:, step])
        other._simulation.step_whole(1)  # all but the state is of the state before
        for name in fields:
            expected = getattr(other.data, name)
            np.testing.assert_array_equal(
                records[name][:, step], expected.reshape(_ROWS, *records[name].shape[2:]), name
            )
    np.testing.assert_array_equal(ours.data.state, other.data.state)


@pytest.mark.usefixtures("share")
def test_records_are_written_over_on_request() -> None:
    physics = _physics()
    first, _ = physics.roll_out(_controls(), ["qpos", "time"])
    again, _ = physics.roll_out(_controls(), ["time", "qpos", "qvel"], first)
    assert again["qpos"] is first["qpos"]
    assert again["time"] is first["time"]
    assert list(again) == ["time", "qpos", "qvel"]


@pytest.mark.usefixtures("share")
def test_a_row_that_diverges_stops() -> None:
    physics = _physics()
    physics.data.qvel[1] = 1e9
    records, diverged = physics.roll_out(_controls(), ["time"])
    assert diverged.tolist() == [False, True, False]
    assert (records["time"][1] == records["time"][1, -1]).all()
    assert (np.diff(records["time"][0], axis=0) > 0).all()


def test_what_cannot_be_recorded_is_named() -> None:
    physics = _physics()
    state = physics.data.state.copy()
    with pytest.raises(ValueError, match="state is not"):
        physics.roll_out(_controls(), ["state"])
    np.testing.assert_array_equal(physics.data.state, state)


@pytest.mark.usefixtures("share")
def test_who_diverged_in_any_of_several_steps_is_told_at_their_end() -> None:
    at_once, one_by_one = _physics(), _physics()
    expected = np.zeros(_ROWS, bool)
    at_once.forget_divergence()
    for step, controls in enumerate(_controls().swapaxes(0, 1)):
        for physics in (at_once, one_by_one):
            if step == 3:
                physics.data.qvel[1] = 1e9
            physics.set_control(controls)
        at_once.step_on(None, 2)
        expected |= one_by_one.step_rows(None, 2)
    assert expected.tolist() == [False, True, False]
    np.testing.assert_array_equal(at_once.diverged(), expected)
    np.testing.assert_array_equal(at_once.data.state, one_by_one.data.state)
    at_once.forget_divergence()
    assert not at_once.diverged().any()


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("task", ["bring_ball", "insert_peg"])
def test_rows_that_were_loaded_everywhere_go_on_as_those_that_were_loaded_whole(task: str) -> None:
    whole, bare = _physics(task), _physics(task)
    fields = ("body_pos", "body_quat")
    one = whole.save_rows(np.array([1]), fields)
    whole.load_rows({name: np.repeat(value, _ROWS, axis=0) for name, value in one.items()}, None)
    bare.load_everywhere(one)
    recorded = ["qpos", "qvel", "time", "site_xpos", "sensordata"]
    expected, _ = whole.roll_out(_controls(), recorded)
    found, _ = bare.roll_out(_controls(), recorded)
    for name in recorded:
        np.testing.assert_array_equal(found[name], expected[name], name)


@pytest.mark.usefixtures("share")
def test_steps_in_passing_are_steps() -> None:
    one_by_one, in_passing = _physics(), _physics()
    for physics in (one_by_one, in_passing):
        physics.data.site_xpos  # noqa: B018  # asked for before
    for step, control in enumerate(_controls().swapaxes(0, 1)):
        for physics in (one_by_one, in_passing):
            physics.set_control(control)
        one_by_one.step_on(None, 3)
        in_passing.step_on(None, 3, in_passing=step < _STEPS - 1)
        np.testing.assert_array_equal(in_passing.data.site_xpos, one_by_one.data.site_xpos)
    # What nobody has asked for before is made up for from the last step.
    for name in ("state", "qacc", "xquat", "sensordata"):
        expected = getattr(one_by_one.data, name)
        np.testing.assert_array_equal(getattr(in_passing.data, name), expected, name)
