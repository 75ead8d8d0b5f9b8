"""A batch has the interface of a simulation; fields bound late are as if bound at the start."""

import ctypes
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import batch_simulation
from limberjack.mujoco.batch_simulation import BatchSimulation
from limberjack.mujoco.simulation import STATE, Simulation
from limberjack.mujoco.wrapper.core import callback_context
from limberjack.planner.history import History
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.control import PhysicsError
from limberjack.rl.randomize import scale
from tests.representatives import EVERY_TASK

_ROWS = 3
_NUM_ENVS = 3  # walkers
_XML = """
<mujoco>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0" damping=".1"/><geom name="rod" size=".1" pos=".5 0 0"/>
    </body>
  </worldbody>
  <actuator><motor joint="hinge"/></actuator>
  <keyframe><key qpos=".3" qvel="1"/></keyframe>
</mujoco>
"""


def _pair() -> tuple[Any, list[Any]]:
    """A batch and single simulations of the same model, in different states."""
    from limberjack.mujoco import Physics

    singles = [Physics.from_xml_string(_XML) for _ in range(_ROWS)]
    batch = singles[0].replicate(_ROWS, 2, ("body_mass",)).physics
    for row, single in enumerate(singles):
        single.data.qpos[0] = batch.data.qpos[row] = 0.1 * row
        single.data.ctrl[0] = batch.data.ctrl[row] = 0.5 * row
    return batch, singles


_CALLS: dict[str, Callable[[Any], object]] = {
    "step": lambda physics: physics.simulation.step(3),
    "step_whole": lambda physics: physics.simulation.step_whole(3),
    "forward": lambda physics: physics.forward(),
    "after_reset": lambda physics: physics.after_reset(),
    "reset": lambda physics: (physics.simulation.reset(), physics.after_reset()),
    "reset to a keyframe": lambda physics: (physics.simulation.reset(0), physics.after_reset()),
    "set_control": lambda physics: (
        physics.set_control(np.full(1, 0.25)),
        physics.simulation.step(1),
    ),
}


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("call", _CALLS)
def test_a_call_has_the_same_effect_on_a_row_as_on_a_single_simulation(call: str) -> None:
    batch, singles = _pair()
    for physics in (batch, *singles):
        physics.forward()
        _CALLS[call](physics)
    for row, single in enumerate(singles):
        for name in ("qpos", "qvel", "qacc", "xpos", "geom_xpos", "actuator_force", "time"):
            found = getattr(batch.data, name)[row]
            expected = np.reshape(getattr(single.data, name), found.shape)
            np.testing.assert_array_equal(found, expected, f"{name} of row {row}")
        assert batch.get_state()[row].tolist() == single.get_state().tolist()
        assert batch.time()[row] == single.time()


@pytest.mark.parametrize("signature", [None, STATE, mujoco.mjtState.mjSTATE_QVEL.value])
def test_states_are_read_and_set_row_by_row(signature: int | None) -> None:
    batch, _ = _pair()
    batch.simulation.step(2)
    state = batch.get_state(signature)
    assert state.shape[0] == _ROWS
    other, _ = _pair()
    other.set_state(state, signature)
    np.testing.assert_array_equal(other.get_state(signature), state)
    with pytest.raises(ValueError, match=r"Expected \(3, "):
        other.set_state(state[0], signature)


def test_a_row_that_diverges_raises_an_error_that_names_it() -> None:
    batch, _ = _pair()
    batch.data.ctrl[1] = np.nan
    with pytest.raises(PhysicsError, match=r"BADCTRL in rows \[1\]"):
        batch.forward()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda physics: physics.copy(), "snapshot"),
        (lambda physics: physics.render(), r"render\(rows"),
        (lambda physics: physics.__getstate__(), "pickle its BatchEnvironment"),
        (lambda physics: physics.step(), r"step\(actions\) of its BatchEnvironment"),
        (lambda physics: physics.step(0), r"step\(actions\) of its BatchEnvironment"),
        (lambda physics: physics.step_in_parts(), r"step\(actions\) of its BatchEnvironment"),
        (lambda physics: physics.reset(), r"reset\(rows\) of its BatchEnvironment"),
        (lambda physics: physics.reset(0), r"reset\(rows\) of its BatchEnvironment"),
        (
            lambda physics: physics.reset_context().__enter__(),
            r"reset\(rows\) of its BatchEnvironment",
        ),
    ],
)
def test_a_batch_names_the_call_to_use_instead(call: Callable[[Any], object], message: str) -> None:
    batch, _ = _pair()
    batch.forward()
    before = batch.simulation.save(None, ())
    with pytest.raises(TypeError, match=f"the physics of a batch does not support .*{message}"):
        call(batch)
    for name, values in batch.simulation.save(None, ()).items():
        np.testing.assert_array_equal(values, before[name])


def test_the_model_of_a_batch_is_read_only_except_for_per_row_fields() -> None:
    batch, _ = _pair()
    with pytest.raises(ValueError, match=r"geom_size of the model is shared by all rows.*random"):
        batch.model.geom_size[:] = 2
    with pytest.raises(ValueError, match="shared by all rows"):
        batch.model.geom_size *= 2
    with pytest.raises(ValueError, match="shared by all rows"):
        batch.named.model.geom_size["rod"] = 2
    with pytest.raises(ValueError, match="timestep is shared by all rows"):
        batch.model.opt.timestep = 1
    with pytest.raises(ValueError, match="gravity is shared by all rows"):
        batch.model.opt.gravity[2] = 1
    with pytest.raises(ValueError, match="read-only"):
        batch.model.body_parentid[0] = 5
    assert batch.model.body_mass.shape == (_ROWS, 2)
    batch.model.body_mass[1] *= 2
    assert batch.named.model.body_mass.shape == (_ROWS, 2)


def test_writing_to_the_model_of_a_batch_suggests_randomize() -> None:
    batch = suite.load_batch("humanoid", "walk", 2, 1, seed=0)
    with pytest.raises(ValueError, match="randomize"):
        batch.physics.model.body_mass[:] = 1.0


def test_both_kinds_have_the_whole_interface() -> None:
    batch, (single, *_) = _pair()
    names = [n for n in dir(Simulation) if not n.startswith("_")] + ["num_envs", "warnings"]
    for simulation in (batch.simulation, single.simulation):
        missing = [name for name in names if not hasattr(simulation, name)]
        assert missing == []
    assert isinstance(batch.simulation, BatchSimulation)


def test_a_saved_row_that_mujoco_would_reject_diverges_at_the_next_step() -> None:
    batch, _ = _pair()
    saved = batch.simulation.save(None, ())
    saved["state"][1, 1] = np.nan
    batch.simulation.load(saved)
    assert np.isnan(batch.data.qpos[1, 0])  # not the default pose
    np.testing.assert_array_equal(batch.data.qpos[[0, 2], 0], [0.0, 0.2])
    batch.simulation.step(1)
    assert batch.simulation.warnings.any(axis=-1).tolist() == [False, True, False]


@pytest.mark.usefixtures("share")
def test_a_loaded_row_has_the_constants_of_its_own_fields() -> None:
    from limberjack.mujoco import Physics

    single = Physics.from_xml_string(_XML)
    single.simulation.sets_constants = True
    simulation = single.replicate(_ROWS, 2, ("body_mass",)).simulation
    simulation.set_fields({"body_mass": np.array([0.0, 7.0])}, row=1)
    simulation.load(simulation.save(np.array([1]), ("body_mass",)), np.array([2]))
    constants, _ = simulation.model_field("body_subtreemass")
    assert constants[2, 1] == 7.0
    assert constants[0, 1] != 7.0


@pytest.mark.usefixtures("share")
def test_a_field_that_is_bound_late_belongs_to_each_rows_own_number_of_steps() -> None:
    batch, singles = _pair()
    rows = np.array([0, 2])
    for physics in (batch, *singles):
        physics.forward()
        physics.simulation.step(1)
    batch.simulation.step(4, rows)
    for row in rows:
        singles[row].simulation.step(4)
    for name in ("qacc", "geom_xpos"):
        found = getattr(batch.data, name)
        for row, single in enumerate(singles):
            np.testing.assert_array_equal(found[row], getattr(single.data, name), f"{name} {row}")


@pytest.mark.usefixtures("share")
def test_a_field_that_is_bound_after_a_direct_call_belongs_to_its_state() -> None:
    batch, singles = _pair()
    batch.forward()
    velocity = mujoco.mjtStage.mjSTAGE_VEL.value
    batch.simulation.call_directly(lambda official: official.step(None, 4, velocity))
    for row, single in enumerate(singles):
        single.set_state(batch.simulation.state[row], STATE)
        single.forward()
        np.testing.assert_array_equal(batch.data.geom_xpos[row], single.data.geom_xpos)


def test_arrays_of_a_forked_child_are_those_of_its_own_batch(
    run_script: Callable[..., str],
) -> None:
    printed = run_script(
        """
import os
import numpy as np
from limberjack import suite

batch = suite.load_batch("pendulum", "swingup", 2, 1, seed=0)
batch.reset()
angles = batch.physics.data.qpos, batch.physics.named.data.qpos
if os.fork() == 0:
    before = batch.physics.data.qpos.copy()
    batch.step(np.ones((2, 1)))
    named = batch.physics.named.data.qpos["hinge"]
    moved = (batch.physics.data.qpos != before).all() and (named != before).all()
    print(moved, flush=True)
    os._exit(0)
os.wait()
"""
    )
    assert printed == "True\n"


_CALLBACKS = [n.removeprefix("get_") for n in dir(mujoco) if n.startswith("get_mjcb_")]


@pytest.mark.parametrize("callback", _CALLBACKS)
@pytest.mark.parametrize("kind", ["step", "step_whole", "forward", "start", "reset", "load"])
def test_a_batch_that_refuses_a_python_callback_is_unchanged(callback: str, kind: str) -> None:
    batch, _ = _pair()
    simulation = batch.simulation
    simulation.step(3)
    saved = simulation.save(None, ("body_mass",))
    calls: dict[str, Callable[[], None]] = {
        "step": lambda: simulation.step(2),
        "step_whole": lambda: simulation.step_whole(2),
        "forward": simulation.forward,
        "start": simulation.forward_without_actuation,
        "reset": simulation.reset,
        "load": lambda: simulation.load({n: 0 * v for n, v in saved.items()}),
    }
    message = f"^{callback} is a Python function.*None.*ctypes"
    with callback_context(callback, lambda *_: 0), pytest.raises(ValueError, match=message):
        calls[kind]()
    for name, value in simulation.save(None, ("body_mass",)).items():
        np.testing.assert_array_equal(value, saved[name])


@pytest.mark.parametrize("callback", _CALLBACKS)
def test_replicas_can_be_asked_before_a_step(callback: str) -> None:
    rows = suite.load("pendulum", "swingup").physics.replicate(2, 1)
    rows.check()
    with callback_context(callback, time.time), pytest.raises(ValueError, match=callback):
        rows.check()
    rows.check()


def test_a_batch_runs_a_callback_compiled_in_c() -> None:
    batch, _ = _pair()
    called = []
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
    with callback_context("mjcb_control", kind(lambda model, data: called.append(model))):
        batch.simulation.step(2)
    assert len(called) == 2 * _ROWS


@pytest.mark.parametrize("nstep", [0, -3, 1.5, True, None, 2**31])
def test_a_batch_takes_at_least_one_step(nstep: Any) -> None:
    physics = suite.load("pendulum", "swingup").physics.replicate(2, 1).physics
    for step in (physics.simulation.step, physics.simulation.step_whole):
        with pytest.raises(ValueError, match=rf"nstep is {nstep}; expected a whole .* at least 1"):
            step(nstep)
    assert physics.time().tolist() == [0.0, 0.0]


def _walkers(bound: str | None = None) -> BatchEnvironment:
    """A batch, optionally with one field bound from the start."""
    batch = suite.load_batch("humanoid", "walk", _NUM_ENVS, 2, seed=1)
    if bound is not None:
        getattr(batch.physics.data, bound)
    batch.reset()
    return batch


def _actions(batch: BatchEnvironment, count: int) -> np.ndarray:
    return np.random.RandomState(2).uniform(-1, 1, (count, *batch.action_spec().shape))


def _step(action: np.ndarray, *batches: BatchEnvironment) -> None:
    for batch in batches:
        batch.step(action)
    first, *others = [batch.physics.data.state for batch in batches]
    for other in others:
        np.testing.assert_array_equal(other, first)


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("name", ["sensordata", "cacc", "cfrc_int", "cfrc_ext"])
def test_a_field_that_is_bound_late_is_as_if_bound_early(name: str) -> None:
    late, early = _walkers(), _walkers(name)
    for number, action in enumerate(_actions(late, 40)):
        _step(action, late, early)
        if number == 34:  # they have fallen
            late.reset([1])
            early.reset([1])
        if number >= 34:
            values = getattr(early.physics.data, name)
            assert np.abs(values).max() > 1
            np.testing.assert_array_equal(getattr(late.physics.data, name), values)


@pytest.mark.usefixtures("share")
@pytest.mark.parametrize("task", EVERY_TASK)
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


def test_a_history_records_readings_that_are_bound_late() -> None:
    physics, other = _walkers().physics, _walkers("sensordata").physics
    history = History(physics.simulation, 2)
    seen = history.read_by(physics)

    def read() -> np.ndarray:
        history.begin()
        for step in range(2):
            for one in (physics, other):
                one.simulation.step(5)
            history.record(step)
        return seen.named.data.sensordata["torso_accel"]

    seen.named.data.sensordata["torso_subtreelinvel"]
    read()
    assert not history.is_complete
    read()
    assert history.is_complete
    last = seen.named.data.sensordata["torso_accel"][_NUM_ENVS:]
    np.testing.assert_array_equal(last, other.named.data.sensordata["torso_accel"])


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
    simulation = batch.physics.simulation
    names = ("xpos", "qfrc_bias", "subtree_com")
    constants = ("body_mass", "body_subtreemass", "dof_invweight0")
    expected = {name: simulation.data_field(name)[0].copy() for name in names}
    expected |= {name: simulation.model_field(name)[0].copy() for name in constants}
    before = simulation.data_field("xpos")[0]
    simulation.abandon()  # as in a forked child
    for name in names:
        np.testing.assert_array_equal(simulation.data_field(name)[0], expected[name])
    for name in constants:
        np.testing.assert_array_equal(simulation.model_field(name)[0], expected[name])
        assert (expected[name][0] != expected[name][1]).any()
    assert simulation.data_field("xpos")[0] is not before


def test_every_callback_of_this_mujoco_is_looked_at() -> None:
    names = "act_bias act_dyn act_gain contactfilter control passive sensor time"
    assert list(batch_simulation._CALLBACKS) == [f"mjcb_{name}" for name in names.split()]
    batch_simulation.check_callbacks()
