"""Tests of limberjack.mujoco.single_simulation."""

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import wrapper
from limberjack.mujoco.single_simulation import SingleSimulation
from limberjack.mujoco.wrapper.sharing import SharedModel
from limberjack.rl.control import PhysicsError

_XML = """
<mujoco>
  <option{}/>
  <worldbody>
    <body><joint name="hinge" axis="0 1 0"/><geom size=".1" pos=".5 0 0"/></body>
  </worldbody>
  <actuator><motor joint="hinge"/></actuator>
</mujoco>
"""
_GRAVITY = mujoco.mjtDisableBit.mjDSBL_GRAVITY.value
_ACTUATION = mujoco.mjtDisableBit.mjDSBL_ACTUATION.value


def made(shared: bool, option: str = "") -> tuple[SingleSimulation, wrapper.MjData]:
    model = mujoco.MjModel.from_xml_string(_XML.format(option))
    data = wrapper.MjData(wrapper.MjModel(SharedModel(model) if shared else model))
    return SingleSimulation(data), data


both_kinds = pytest.mark.parametrize("shared", [False, True], ids=["own", "shared"])


@both_kinds
@pytest.mark.parametrize("option", ["", " integrator='RK4'", " integrator='implicit'"])
def test_its_steps_are_mujocos(shared: bool, option: str) -> None:
    simulation, data = made(shared, option)
    model = data.model._official
    theirs = mujoco.MjData(model)
    simulation.forward()
    for nstep in (1, 2, 7):
        data.ctrl[:] = theirs.ctrl[:] = 0.3 * nstep
        simulation.step(nstep)
        mujoco.mj_step(model, theirs, nstep)
        assert (data.qpos[0], data.qvel[0], data.time) == (
            theirs.qpos[0],
            theirs.qvel[0],
            theirs.time,
        )
    simulation.step_whole(3)
    mujoco.mj_step(model, theirs, 3)
    assert (data.qpos[0], data.qvel[0]) == (theirs.qpos[0], theirs.qvel[0])


@both_kinds
def test_a_forward_pass_without_actuation_has_none_and_leaves_it_enabled(shared: bool) -> None:
    simulation, data = made(shared)
    data.ctrl[:] = 2.0
    simulation.forward_without_actuation()
    assert data.actuator_force[0] == 0.0
    assert data.qacc[0] != 0.0  # gravity acts
    assert data.model._official.opt.disableflags == 0
    simulation.forward()
    assert data.actuator_force[0] == 2.0


@both_kinds
def test_flags_disabled_by_the_user_stay_disabled(shared: bool) -> None:
    simulation, data = made(shared)
    data.model.opt.disableflags = _GRAVITY
    simulation.forward_without_actuation()
    assert data.qacc[0] == 0.0
    assert data.model._official.opt.disableflags == _GRAVITY


def test_an_error_in_the_forward_pass_leaves_actuation_enabled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    simulation, data = made(shared=False)

    def fail(*_: object) -> None:
        assert data.model._official.opt.disableflags == _ACTUATION
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(mujoco, "mj_forward", fail)
        with pytest.raises(KeyboardInterrupt):
            simulation.forward_without_actuation()
    assert data.model._official.opt.disableflags == 0
    data.ctrl[:] = 2.0
    simulation.forward()
    assert data.actuator_force[0] == 2.0


def _interrupted_at(line: int, call: Callable[[], None]) -> bool:
    """Calls with an interrupt before the n-th line of its own code; whether it came that far."""
    left = line

    def trace(frame: FrameType, event: str, _: object) -> Any:  # any trace function
        nonlocal left
        if frame.f_code is not SingleSimulation.forward_without_actuation.__code__:
            return None
        if event == "line":
            left -= 1
            if left < 0:
                raise KeyboardInterrupt
        return trace

    outer = sys.gettrace()
    sys.settrace(trace)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(outer)
    return False


def test_an_interrupt_at_any_line_of_the_forward_pass_leaves_actuation_enabled() -> None:
    line = 0
    while True:
        simulation, data = made(shared=False)
        was_interrupted = _interrupted_at(line, simulation.forward_without_actuation)
        data.ctrl[:] = 2.0
        simulation.forward()
        assert data.actuator_force[0] == 2.0, line
        if not was_interrupted:
            break
        line += 1
    assert line > 8


def test_a_copy_of_a_state_that_mujoco_would_replace_is_refused() -> None:
    simulation, data = made(shared=False)
    data.qpos[0] = np.nan
    with pytest.raises(PhysicsError):
        simulation.copy(share_model=True)


def test_a_shared_model_is_read_and_never_copied_by_running() -> None:
    simulation, data = made(shared=True)
    model = data.model._official
    simulation.reset()
    simulation.forward_without_actuation()
    simulation.step(3)
    simulation.step_whole(1)
    simulation.forward()
    assert data.model._official is model
    assert data.model._shared is not None


def test_it_follows_a_model_that_became_its_own() -> None:
    simulation, data = made(shared=True)
    simulation.forward_without_actuation()
    data.model.opt.gravity[:] = 0.0
    simulation.forward_without_actuation()
    assert data.qacc[0] == 0.0
    simulation.step(2)
    assert data.qvel[0] == 0.0


def test_warnings_are_counted_live_and_cleared_by_a_reset() -> None:
    simulation, data = made(shared=True)
    assert simulation.warnings.shape == (len(mujoco.mjtWarning.__members__) - 1,)
    data.ctrl[:] = np.nan
    simulation.step(2)
    assert simulation.warnings[mujoco.mjtWarning.mjWARN_BADCTRL.value] > 0
    simulation.reset()
    assert not simulation.warnings.any()


@both_kinds
@pytest.mark.parametrize("step", ["step", "step_whole"])
def test_a_loaded_state_has_the_quantities_of_the_call_that_led_to_it(
    shared: bool, step: str
) -> None:
    simulation, data = made(shared)
    other, loaded = made(shared)
    data.ctrl[:] = 0.7
    simulation.forward()
    getattr(simulation, step)(3)
    other.load(simulation.save(None, ()))
    for name in ("qpos", "qvel", "qacc", "xpos", "xipos", "qfrc_bias", "actuator_force"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(data, name), name)


def test_a_state_that_no_call_led_to_keeps_its_readings() -> None:
    xml = _XML.format("").replace(
        "<actuator>", "<sensor><jointpos joint='hinge'/></sensor><actuator>"
    )
    model = wrapper.MjModel.from_xml_string(xml)
    data, loaded = wrapper.MjData(model), wrapper.MjData(model)
    simulation = SingleSimulation(data)
    simulation.step(3)
    data.qpos[:] = 0.4
    SingleSimulation(loaded).load(simulation.save(None, ()))
    assert loaded.qpos[0] == 0.4
    assert loaded.sensordata[0] == data.sensordata[0] != 0.4


def test_loading_leaves_the_counts_of_warnings_alone() -> None:
    simulation, _ = made(False)
    simulation.step(1)
    saved = simulation.save(None, ())
    simulation.warnings[2] = 3
    simulation.load(saved)
    assert simulation.warnings[2] == 3


@both_kinds
def test_a_copy_keeps_the_record_of_its_own_last_call(shared: bool) -> None:
    simulation, _ = made(shared)
    simulation.step(2)
    copied, expected = simulation.copy(share_model=True), simulation.save(None, ())
    simulation.step(2)
    for name, values in copied.save(None, ()).items():
        np.testing.assert_array_equal(values, expected[name], name)
