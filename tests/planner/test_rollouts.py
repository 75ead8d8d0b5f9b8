"""Many time steps in one call are the same as one after the other."""

import re

import mujoco.batch
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco.engine import Physics
from limberjack.planner.rollouts import Budget, Rollouts
from tests.clocks import Clock

_ROWS, _STEPS = 3, 12
_BALLS = 12
_FIELDS = ("body_pos", "body_quat")


def _rollouts(task: str = "bring_ball") -> Rollouts:
    """Simulations in which each row has begun an episode of its own."""
    env = suite.load("manipulator", task, {"random": 5})
    made = Rollouts(env.physics, _ROWS, 2, _FIELDS)
    batch = suite.load_batch("manipulator", task, _ROWS, 2, seed=5)
    batch.reset()
    made.simulation.load(batch.snapshot().physics)
    return made


def _controls() -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (_ROWS, _STEPS, 5))


@pytest.mark.usefixtures("share")
def test_records_and_the_end_are_those_of_single_steps() -> None:
    ours, other = _rollouts(), _rollouts()
    controls = _controls()
    fields = ["qpos", "time", "site_xpos", "actuator_force"]
    records, diverged = ours.roll_out(controls, fields)
    assert not diverged.any()
    for step in range(_STEPS):
        other.physics.set_control(controls[:, step])
        other.simulation.step_whole(1)  # all but the state is of the state before
        for name in fields:
            expected = getattr(other.physics.data, name)
            np.testing.assert_array_equal(
                records[name][:, step], expected.reshape(_ROWS, *records[name].shape[2:]), name
            )
    np.testing.assert_array_equal(ours.simulation.state, other.simulation.state)


@pytest.mark.usefixtures("share")
def test_records_are_written_over_by_the_next_call() -> None:
    rollouts = _rollouts()
    first, _ = rollouts.roll_out(_controls(), ["qpos", "time"])
    again, _ = rollouts.roll_out(_controls(), ["time", "qpos", "qvel"])
    assert again["qpos"] is first["qpos"]
    assert again["time"] is first["time"]
    assert list(again) == ["time", "qpos", "qvel"]


@pytest.mark.usefixtures("share")
def test_a_row_that_diverges_stops() -> None:
    rollouts = _rollouts()
    rollouts.physics.data.qvel[1] = 1e9
    records, diverged = rollouts.roll_out(_controls(), ["time"])
    assert diverged.tolist() == [False, True, False]
    assert (records["time"][1] == records["time"][1, -1]).all()
    assert (np.diff(records["time"][0], axis=0) > 0).all()


def test_what_cannot_be_recorded_is_named() -> None:
    rollouts = _rollouts()
    state = rollouts.simulation.state.copy()
    with pytest.raises(ValueError, match="state is not"):
        rollouts.roll_out(_controls(), ["state"])
    np.testing.assert_array_equal(rollouts.simulation.state, state)


@pytest.mark.usefixtures("share")
def test_divergence_in_any_of_several_steps_is_reported_at_their_end() -> None:
    rollouts = _rollouts()
    expected = np.zeros(_ROWS, bool)
    batch = suite.load_batch("manipulator", "bring_ball", _ROWS, 2, seed=5)
    batch.reset()
    for step, controls in enumerate(_controls().swapaxes(0, 1)):
        for physics in (rollouts.physics, batch.physics):
            if step == 3:
                physics.data.qvel[1] = 1e9
            physics.set_control(controls)
        rollouts.step(2)
        expected |= batch._replicas.step(None, 2)
    assert expected.tolist() == [False, True, False]
    np.testing.assert_array_equal(rollouts.diverged(), expected)
    np.testing.assert_array_equal(rollouts.simulation.state, batch.physics.simulation.state)
    env = suite.load("manipulator", "bring_ball", {"random": 5})
    rollouts.load(env.physics.simulation.save(None, _FIELDS))
    assert not rollouts.diverged().any()


def test_a_row_in_which_mujoco_raises_has_diverged_and_the_others_go_on() -> None:
    balls = "".join(
        f'<body pos="{x} 0 0"><freejoint/><geom size=".1"/></body>' for x in range(_BALLS)
    )
    physics = Physics.from_xml_string(
        # Memory for the constraints of balls that all touch, and not for solving them.
        f'<mujoco><size memory="150K"/><worldbody>{balls}</worldbody></mujoco>'
    )
    rollouts = Rollouts(physics, _ROWS, 2, ())
    saved = {"state": rollouts.simulation.state[:1].copy()}
    rollouts.physics.data.qpos[1, ::7] = np.linspace(0.0, 0.1, _BALLS)
    with pytest.raises(mujoco.batch.SimulationError, match="out of memory"):
        rollouts.simulation.step(1)
    rollouts.load(saved)
    rollouts.physics.data.qpos[1, ::7] = np.linspace(0.0, 0.1, _BALLS)
    for _ in range(3):
        rollouts.step(2)
    assert rollouts.diverged().tolist() == [False, True, False]
    state = rollouts.simulation.state.copy()
    assert rollouts.physics.data.time[1] == 0
    rollouts.load(saved)  # and all begin again
    for _ in range(3):
        rollouts.step(2)
    assert not rollouts.diverged().any()
    np.testing.assert_array_equal(state[[0, 2]], rollouts.simulation.state[[0, 2]])


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("task", ["bring_ball", "insert_peg"])
def test_rollouts_that_were_loaded_go_on_as_the_state_that_was_saved(task: str) -> None:
    env = suite.load("manipulator", task, {"random": 6})
    env.reset()
    for action in np.random.default_rng(1).uniform(-1, 1, (20, 5)):
        env.step(action)
    whole, bare = _rollouts(task), _rollouts(task)
    saved = env.snapshot().physics
    every = {name: np.repeat(value, _ROWS, axis=0) for name, value in saved.items()}
    whole.simulation.load(every)
    bare.load(saved)
    recorded = ["qpos", "qvel", "time", "site_xpos", "sensordata"]
    expected, _ = whole.roll_out(_controls(), recorded)
    found, _ = bare.roll_out(_controls(), recorded)
    for name in recorded:
        np.testing.assert_array_equal(found[name], expected[name], name)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of budgets, set by hand."""
    made = Clock()
    monkeypatch.setattr("limberjack.planner.rollouts.time.perf_counter", made)
    return made


def test_a_budget_takes_the_most_samples_for_which_there_is_time(clock: Clock) -> None:
    budget = Budget(10, 64)
    budget.begin()
    assert budget.size() == 8  # nothing has been measured
    clock.now += 0.002  # 0.25 ms per sample: 40 in all
    budget.spent(8)
    budget.begin()
    assert budget.size() == 32
    budget.begin()
    clock.now += 0.004  # before the samples, as for a path search
    assert budget.size() == 16
    budget.begin()
    clock.now += 0.02
    assert budget.size() == 8


def test_a_budget_follows_changes_of_the_time_that_a_sample_takes(clock: Clock) -> None:
    budget = Budget(10, 32)
    for _ in range(40):
        budget.begin()
        size = budget.size()
        clock.now += 0.0001 * size
        budget.spent(size)
    assert budget.size() == 32
    for _ in range(40):  # the machine became busy
        budget.begin()
        size = budget.size()
        clock.now += 0.001 * size
        budget.spent(size)
    budget.begin()
    assert budget.size() == 8


@pytest.mark.parametrize("wrong", [0, -1.0, float("nan"), float("inf")])
def test_a_budget_is_a_positive_time(wrong: float) -> None:
    with pytest.raises(ValueError, match=re.escape(f"max_ms is {wrong!r}; expected a positive")):
        Budget(wrong, 8)


def test_a_budget_is_a_number() -> None:
    with pytest.raises(TypeError, match="max_ms is of type str; expected a number"):
        Budget("10", 8)  # type: ignore[arg-type]
