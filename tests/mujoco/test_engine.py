"""Tests of limberjack.mujoco.engine: a Physics, its state as one array, and its controls' spec."""

import contextlib
import logging
import pickle
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics, action_spec, engine, wrapper
from limberjack.rl import control
from tests.representatives import EVERY_TASK

_PENDULUM = """
<mujoco model="pendulum">
  <option timestep="0.01"/>
  <worldbody>
    <body name="pole">
      <joint name="hinge" axis="0 1 0"/>
      <geom name="pole" type="capsule" fromto="0 0 0 0 0 -1" size=".05" mass="1"/>
    </body>
    <body name="puck" pos="1 0 0">
      <joint name="slide" type="slide" axis="1 0 0" limited="true" range="-1 1"/>
      <geom name="puck" size=".1"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="torque" joint="hinge" ctrllimited="true" ctrlrange="-2 3"/>
    <general name="filtered" joint="slide" dyntype="filter" dynprm="0.1"/>
  </actuator>
  <sensor>
    <actuatorfrc name="torque" actuator="torque"/>
    <jointpos name="angle" joint="hinge"/>
  </sensor>
  <keyframe>
    <key name="aside" qpos="0.7 0.1" qvel="1 2"/>
    <key name="down"/>
  </keyframe>
</mujoco>
"""
_FILTERED = """
<mujoco>
  <worldbody><body><joint name="hinge"/><geom size=".1" pos=".5 0 0"/></body></worldbody>
  <actuator><general joint="hinge" dyntype="filter" dynprm=".1"/></actuator>
</mujoco>
"""
_VELOCITY = mujoco.mjtState.mjSTATE_QVEL.value
_WARM_START = mujoco.mjtState.mjSTATE_WARMSTART.value
_ACTUATED = """
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
_INTEGRATION = mujoco.mjtState.mjSTATE_INTEGRATION.value


@pytest.fixture
def physics() -> Physics:
    return Physics.from_xml_string(_PENDULUM)


def swing(physics: Physics, steps: int) -> list[bytes]:
    """The states of a swing."""
    states = []
    for step in range(steps):
        physics.set_control([np.sin(step), 0.5])
        physics.step()
        states.append(physics.get_state(_INTEGRATION).tobytes())
    return states


def test_every_constructor_makes_the_same_simulation(tmp_path: Path) -> None:
    xml_path, binary_path = tmp_path / "pendulum.xml", tmp_path / "pendulum.mjb"
    xml_path.write_text(_PENDULUM)
    physics = Physics.from_xml_string(_PENDULUM.encode())
    physics.model.save_binary(str(binary_path))
    made = [
        Physics.from_xml_path(str(xml_path)),
        Physics.from_binary_path(str(binary_path)),
        Physics.from_byte_string(physics.model.to_bytes()),
        Physics.from_byte_string(binary_path.read_bytes()),
        Physics.from_model(wrapper.MjModel.from_xml_string(_PENDULUM)),
        Physics.from_shared_xml(_PENDULUM, {}),
        Physics(wrapper.MjData(physics.model.copy())),
    ]
    expected = swing(physics, 20)
    for other in made:
        assert swing(other, 20) == expected


def test_the_repr_has_the_domain_the_rows_and_the_sizes() -> None:
    physics = suite.load("cartpole", "balance").physics
    assert repr(physics) == "<cartpole.Physics: nq=2, nv=2, nu=1>"
    batch = suite.load_batch("cartpole", "balance", 3).physics
    assert repr(batch) == "<cartpole.Physics, 3 rows: nq=2, nv=2, nu=1>"
    physics.free()
    assert repr(physics) == "<cartpole.Physics, closed>"


def test_assets_are_found_by_name() -> None:
    xml = "<mujoco><include file='./parts/body.xml'/></mujoco>"
    part = "<mujoco><worldbody><body name='included'/></worldbody></mujoco>"
    for assets in ({"./parts/body.xml": part.encode()}, {"parts/body.xml": part.encode()}):
        physics = Physics.from_xml_string(xml, assets)
        assert physics.model.name2id("included", "body") == 1
    physics.reload_from_xml_string(_PENDULUM)
    assert physics.model.name == "pendulum"
    physics.reload_from_xml_string(xml, assets)
    assert physics.model.nbody == 2


def test_models_of_one_source_are_shared_and_of_another_are_not() -> None:
    first, second = (Physics.from_shared_xml(_PENDULUM, {}) for _ in range(2))
    other = Physics.from_shared_xml(_PENDULUM, {"a.xml": b"<mujoco/>"})
    alone = Physics.from_xml_string(_PENDULUM)
    assert first.model._official is second.model._official
    assert first.model._official is not other.model._official
    assert first.model._official is not alone.model._official


def test_reloading_takes_the_new_model_and_its_names(physics: Physics, tmp_path: Path) -> None:
    assert physics.named.data.qpos["hinge"] == [0.0]
    path = tmp_path / "other.xml"
    path.write_text(_PENDULUM.replace("hinge", "axle"))
    physics.reload_from_xml_path(str(path))
    physics.named.data.qpos["axle"] = 0.5
    assert physics.data.qpos[0] == 0.5
    with pytest.raises(KeyError, match="hinge"):
        physics.named.data.qpos["hinge"]
    fresh = Physics.from_xml_path(str(path))
    physics.reset()
    assert swing(physics, 5) == swing(fresh, 5)


@pytest.mark.parametrize("legacy_step", [True, False])
@pytest.mark.parametrize("nstep", [0, -5, 1.0, 2.5, True, None, "1", 2**31, 2**70])
def test_a_number_of_steps_that_is_none_is_refused_and_changes_nothing(
    nstep: Any, legacy_step: bool
) -> None:
    physics = Physics.from_xml_string(_PENDULUM)
    physics.legacy_step = legacy_step
    physics.data.warning.number[:] = 1
    whole = mujoco.mjtState.mjSTATE_INTEGRATION.value
    before = physics.get_state(whole)
    for step in (physics.step, physics.simulation.step, physics.simulation.step_whole):
        with pytest.raises(ValueError, match=rf"nstep is {nstep!r}; expected a whole number"):
            step(nstep)
    np.testing.assert_array_equal(physics.get_state(whole), before)
    assert (physics.data.warning.number == 1).all()


def test_a_number_of_steps_may_be_numpys() -> None:
    physics = Physics.from_xml_string(_PENDULUM)
    physics.step(np.int64(3))  # pyright: ignore[reportArgumentType]
    assert physics.time() == pytest.approx(0.03)


@pytest.mark.parametrize("keyframe", [0.5, "aside", [0]])
def test_a_keyframe_that_is_no_number_is_refused(keyframe: Any) -> None:
    physics = Physics.from_xml_string(_PENDULUM)
    physics.step(3)
    with pytest.raises(TypeError, match=r"keyframe_id is .*; expected a keyframe's number"):
        physics.reset(keyframe)
    assert physics.time() > 0


@pytest.mark.parametrize("nstep", [1, 2, 5])
@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
def test_a_step_is_mujocos_and_positions_are_up_to_date_after_it(
    integrator: str, nstep: int
) -> None:
    xml = _PENDULUM.replace("<option", f"<option integrator='{integrator}'")
    physics = Physics.from_xml_string(xml)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    for step in range(10):
        data.ctrl[:] = [np.cos(step), 1.0]
        mujoco.mj_step(model, data, nstep)
        physics.set_control([np.cos(step), 1.0])
        physics.step(nstep)
        np.testing.assert_array_equal(physics.get_state(_INTEGRATION), _state(model, data))
        up_to_date = mujoco.MjData(model)
        up_to_date.qpos[:], up_to_date.qvel[:] = data.qpos, data.qvel
        mujoco.mj_forward(model, up_to_date)
        np.testing.assert_array_equal(physics.data.xpos, up_to_date.xpos)
        np.testing.assert_array_equal(physics.data.cvel, up_to_date.cvel)
        assert physics.named.data.sensordata["angle"] == physics.data.qpos[0]
    assert physics.time() == pytest.approx(10 * nstep * 0.01)


@pytest.mark.parametrize("legacy_step", [True, False])
@pytest.mark.parametrize("nstep", [1, 2, 5])
def test_a_step_in_parts_is_a_step(physics: Physics, legacy_step: bool, nstep: int) -> None:
    other = Physics.from_xml_string(_PENDULUM)
    for one in (physics, other):
        one.legacy_step = legacy_step
        one.set_control([1.0, 0.5])
    for _ in range(3):
        physics.step(nstep)
        advance, check = other.step_in_parts(nstep)
        before = other.get_state(_INTEGRATION)
        thread = threading.Thread(target=advance)
        thread.start()
        thread.join()
        check()
        assert not np.array_equal(other.get_state(_INTEGRATION), before)
        for name in ("qpos", "qacc", "xpos", "sensordata", "warning"):
            found, expected = (getattr(one.data, name) for one in (other, physics))
            np.testing.assert_array_equal(np.asarray(found), np.asarray(expected))
        for name, saved in physics.simulation.save(None, ()).items():
            np.testing.assert_array_equal(other.simulation.save(None, ())[name], saved)


def test_a_step_in_parts_that_diverges_raises_in_its_last_part(physics: Physics) -> None:
    physics.data.qvel[0] = np.inf
    advance, check = physics.step_in_parts()
    advance()
    with pytest.raises(control.PhysicsError):
        check()
    physics.reset()
    with pytest.raises(ValueError, match="nstep is 0"):
        physics.step_in_parts(0)


def test_a_step_of_ones_own_is_not_taken_in_parts(physics: Physics) -> None:
    class Own(Physics):
        def step(self, nstep: int = 1) -> None:
            super().step(nstep)

    class Same(Physics):
        pass

    assert physics.can_step_in_parts
    assert Same.from_xml_string(_PENDULUM).can_step_in_parts
    assert not Own.from_xml_string(_PENDULUM).can_step_in_parts
    physics.step = lambda nstep=1: None
    assert not physics.can_step_in_parts


def test_parts_of_a_step_that_a_subclass_replaces_are_used(physics: Physics) -> None:
    """As in dm_control, where programs replace both."""
    calls: list[tuple[int, bool]] = []

    class Pushing(Physics):
        def _step_with_up_to_date_position_velocity(self, nstep: int = 1) -> None:
            for _ in range(nstep):
                self.data.qfrc_applied[0] = 1.0
                calls.append((nstep, self.legacy_step))
                super()._step_with_up_to_date_position_velocity()

    class Careless(Physics):
        @contextlib.contextmanager
        def check_invalid_state(self) -> Iterator[None]:
            yield

    pushing = Pushing.from_xml_string(_PENDULUM)
    pushing.step(3)
    assert calls == [(3, True)] * 3
    for _ in range(3):
        physics.data.qfrc_applied[0] = 1.0
        physics.step()
    np.testing.assert_array_equal(pushing.get_state(_INTEGRATION), physics.get_state(_INTEGRATION))
    pushing.data.qvel[0] = np.inf
    with pytest.raises(control.PhysicsError):
        pushing.step()
    careless = Careless.from_xml_string(_PENDULUM)
    careless.data.qvel[0] = np.inf
    careless.step()
    for one in (pushing, careless):
        assert not one.can_step_in_parts
    assert physics.can_step_in_parts


def test_without_legacy_step_positions_are_those_before_the_last_sub_step(physics: Physics) -> None:
    model = mujoco.MjModel.from_xml_string(_PENDULUM)
    data = mujoco.MjData(model)
    physics.legacy_step = False
    physics.set_control([1.0, 1.0])
    physics.step(3)
    data.ctrl[:] = 1.0
    mujoco.mj_step(model, data, 3)
    np.testing.assert_array_equal(physics.get_state(_INTEGRATION), _state(model, data))
    np.testing.assert_array_equal(physics.data.xpos, data.xpos)
    before = physics.data.xmat.copy()
    physics.forward()
    assert not np.array_equal(physics.data.xmat, before)


def _state(model: Any, data: Any) -> np.ndarray:
    state = np.empty(mujoco.mj_stateSize(model, _INTEGRATION))
    mujoco.mj_getState(model, data, state, _INTEGRATION)
    return state


def test_a_reset_context_begins_at_the_default_and_makes_quantities_follow(
    physics: Physics,
) -> None:
    swing(physics, 5)
    with physics.reset_context() as same:
        assert same is physics
        assert not physics.data.qpos.any()
        assert physics.time() == 0.0
        physics.named.data.qpos["slide"] = 0.5
        assert physics.named.data.xpos["puck", "x"] == 1.0
    assert physics.named.data.xpos["puck", "x"] == 1.5


def test_an_error_in_a_reset_context_is_passed_on(physics: Physics) -> None:
    with pytest.raises(ZeroDivisionError), physics.reset_context():
        raise ZeroDivisionError


def test_after_a_reset_controls_have_no_effect_and_actuation_is_enabled(physics: Physics) -> None:
    with physics.reset_context():
        physics.set_control([2.0, 1.0])
    assert not physics.data.actuator_force.any()
    assert physics.named.data.sensordata["torque"] == 0.0
    assert physics.model.opt.disableflags == 0
    physics.forward()
    assert physics.data.actuator_force[0] == 2.0
    physics.step()
    assert physics.velocity()[0] != 0.0


def test_a_reset_returns_to_a_keyframe(physics: Physics) -> None:
    physics.reset(0)
    np.testing.assert_array_equal(physics.position(), [0.7, 0.1])
    np.testing.assert_array_equal(physics.velocity(), [1.0, 2.0])
    assert physics.named.data.xpos["puck", "x"] == 1.1
    physics.reset(keyframe_id=1)
    assert not physics.position().any()


@pytest.mark.parametrize("keyframe", [-1, 2, 99])
def test_an_unknown_keyframe_is_refused(physics: Physics, keyframe: int) -> None:
    physics.reset(0)
    match = f"must be between 0 and 1 inclusive, got: {keyframe}"
    with pytest.raises(ValueError, match=match):
        physics.reset(keyframe)
    np.testing.assert_array_equal(physics.position(), [0.7, 0.1])


@pytest.mark.parametrize(
    ("field", "value", "warning"),
    [
        ("qpos", np.nan, "mjWARN_BADQPOS"),
        ("qpos", 1e15, "mjWARN_BADQPOS"),
        ("qvel", np.inf, "mjWARN_BADQ"),
        ("ctrl", np.nan, "mjWARN_BADCTRL"),
        ("qfrc_applied", np.nan, "mjWARN_BADQACC"),
    ],
)
@pytest.mark.parametrize("legacy_step", [True, False])
def test_a_diverged_simulation_raises_naming_the_warning(
    physics: Physics, field: str, value: float, warning: str, legacy_step: bool
) -> None:
    physics.legacy_step = legacy_step
    getattr(physics.data, field)[0] = value
    with pytest.raises(control.PhysicsError, match=warning):
        physics.step(2)
    physics.reset()
    physics.step()


def test_divergence_is_raised_by_every_method_that_detects_it(physics: Physics) -> None:
    physics.data.ctrl[0] = np.nan
    with pytest.raises(control.PhysicsError, match="mjWARN_BADCTRL"):
        physics.forward()
    with pytest.raises(control.PhysicsError), physics.check_invalid_state():
        mujoco.mj_step(physics.model.ptr, physics.data.ptr)
    with physics.check_invalid_state():
        pass


def test_suppressed_divergence_is_logged_and_only_within_the_context(
    physics: Physics, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING, "limberjack"):
        with physics.suppress_physics_errors():
            physics.data.ctrl[0] = np.nan
            physics.step()
        messages = [record.getMessage() for record in caplog.records]
        assert "Physics state is invalid. Warning(s) raised: mjWARN_BADCTRL" in messages
    with pytest.raises(ZeroDivisionError), physics.suppress_physics_errors():
        raise ZeroDivisionError
    with pytest.raises(control.PhysicsError):
        physics.step()


def test_a_model_whose_default_state_is_invalid_is_made_logged_and_given_a_good_one(
    caplog: pytest.LogCaptureFixture,
) -> None:
    boxes = [f"<body pos='{i} 0 0'><freejoint/><geom type='box' size='.3 .3 .3'/></body>"
             for i in range(6)]  # fmt: skip
    xml = f"""
    <mujoco>
      <size memory="8K"/>
      <worldbody><geom type="plane" size="1 1 1"/>{"".join(boxes)}</worldbody>
    </mujoco>
    """
    with caplog.at_level(logging.WARNING, "limberjack"):
        physics = Physics.from_xml_string(xml)  # where there is no room for so many contacts
    assert "mjWARN_CONTACTFULL" in caplog.text
    with pytest.raises(control.PhysicsError, match="mjWARN_CONTACTFULL"):
        physics.reset()
    with physics.reset_context():
        physics.data.qpos[2::7] = 5.0
    assert physics.data.ncon == 0
    physics.step()


def test_the_state_is_positions_velocities_and_activations(physics: Physics) -> None:
    swing(physics, 4)
    state = physics.get_state()
    parts = [physics.position(), physics.velocity(), physics.activation()]
    np.testing.assert_array_equal(state, np.concatenate(parts))
    np.testing.assert_array_equal(physics.state(), state)
    assert [part.size for part in parts] == [2, 2, 1]
    np.testing.assert_array_equal(physics.control(), [np.sin(3), 0.5])


@pytest.mark.parametrize(
    "sig",
    [None, _INTEGRATION, mujoco.mjtState.mjSTATE_INTEGRATION, mujoco.mjtState.mjSTATE_QVEL.value],
)
def test_a_state_that_was_set_is_returned(physics: Physics, sig: Any) -> None:
    swing(physics, 4)
    state = physics.get_state(sig)
    swing(physics, 3)
    assert not np.array_equal(physics.get_state(sig), state)
    physics.set_state(state.tolist(), sig)
    np.testing.assert_array_equal(physics.get_state(sig), state)


def test_the_whole_state_replays_exactly(physics: Physics) -> None:
    swing(physics, 7)
    state = physics.get_state(_INTEGRATION)
    expected = swing(physics, 20)
    physics.set_state(state, _INTEGRATION)
    physics.forward()
    assert swing(physics, 20) == expected


@pytest.mark.parametrize("way", ["copy", "pickle"])
def test_a_copy_has_the_same_future(physics: Physics, way: str) -> None:
    swing(physics, 7)
    other = physics.copy() if way == "copy" else pickle.loads(pickle.dumps(physics))
    assert other.model.name == "pendulum"
    assert other.named.data.qpos["hinge"] == physics.named.data.qpos["hinge"]
    assert swing(other, 10) == swing(physics, 10)
    with pytest.raises(control.PhysicsError):
        (other.set_control(np.nan), other.step())


def test_a_subclass_stays_itself(physics: Physics) -> None:
    class Pendulum(Physics):
        def __init__(self, *args: Any) -> None:
            super().__init__(*args)
            self.own = "attribute"

        def angle(self) -> float:
            return self.named.data.qpos["hinge"][0]

    pendulum = Pendulum.from_xml_string(_PENDULUM)
    assert pendulum.own == "attribute"
    assert pendulum.angle() == 0.0
    assert type(pendulum.copy()) is Pendulum
    with pytest.raises(AttributeError, match="'Pendulum' object has no attribute 'angel'"):
        pendulum.angel  # noqa: B018


def test_an_unknown_attribute_does_not_report_a_closed_physics(physics: Physics) -> None:
    with pytest.raises(AttributeError, match="nothing"):
        physics.nothing  # noqa: B018
    assert not hasattr(physics, "nothing")


def test_only_wrapped_data_makes_a_physics(physics: Physics) -> None:
    for bad in (physics.data.ptr, physics.model, None, _PENDULUM):
        with pytest.raises(TypeError, match=r"Expected wrapper\.MjData"):
            Physics(bad)  # pyright: ignore[reportArgumentType]


def test_controls_are_set_and_returned(physics: Physics) -> None:
    physics.set_control(1.5)
    np.testing.assert_array_equal(physics.control(), [1.5, 1.5])
    with pytest.raises(ValueError, match="broadcast"):
        physics.set_control(np.zeros(3))


def test_profiling_times_mujocos_stages(physics: Physics) -> None:
    before = mujoco.get_mjcb_time()
    try:
        physics.enable_profiling()
        physics.step(3)
        assert physics.data.timer[mujoco.mjtTimer.mjTIMER_STEP].number > 0
        assert physics.data.timer[mujoco.mjtTimer.mjTIMER_STEP].duration > 0
    finally:
        mujoco.set_mjcb_time(before)


def test_the_numbers_of_the_model_are_read_live(physics: Physics) -> None:
    assert physics.timestep() == 0.01
    physics.model.opt.timestep = 0.002
    assert physics.timestep() == 0.002
    physics.step(5)
    assert physics.time() == pytest.approx(0.01)


def test_named_is_made_once_and_follows_the_simulation(physics: Physics) -> None:
    named = physics.named
    assert named is physics.named
    assert isinstance(named, engine.NamedIndexStructs)
    swing(physics, 3)
    np.testing.assert_array_equal(named.data.qpos["hinge"], physics.data.qpos[:1])
    named.data.qpos["hinge"] = 0.25
    named.model.geom_size["puck", 0] = 0.75
    assert physics.data.qpos[0] == 0.25
    assert physics.model.geom_size[1, 0] == 0.75


def test_setting_the_state_sets_positions_velocities_and_activations() -> None:
    physics = Physics.from_xml_string(_FILTERED)
    physics.set_state(np.array([0.1, 0.2, 0.3]))
    assert (physics.data.qpos[0], physics.data.qvel[0], physics.data.act[0]) == (0.1, 0.2, 0.3)
    assert physics.get_state().tolist() == physics.state().tolist() == [0.1, 0.2, 0.3]


def test_a_batch_has_a_row_for_each_simulation() -> None:
    batch = Physics.from_xml_string(_FILTERED).replicate(2, 1).physics
    state = np.arange(6.0).reshape(2, 3)
    batch.set_state(state)
    np.testing.assert_array_equal(batch.get_state(), state)
    np.testing.assert_array_equal(batch.get_state(_VELOCITY), state[:, 1:2])
    batch.set_state(np.array([[7.0], [8.0]]), _VELOCITY)
    np.testing.assert_array_equal(batch.data.qvel, [[7.0], [8.0]])
    assert batch.get_state(_WARM_START).shape == (2, 1)


@pytest.mark.parametrize("shape", [(2,), (4,), (1, 3)])
def test_a_state_of_another_shape_is_refused_and_changes_nothing(shape: tuple[int, ...]) -> None:
    physics = Physics.from_xml_string(_FILTERED)
    with pytest.raises(ValueError, match=r"Expected \(3,\)"):
        physics.set_state(np.ones(shape))
    assert not physics.get_state().any()


@pytest.mark.parametrize("rows", [None, 2])
@pytest.mark.parametrize("sig", [-1, 2**15, 2**31, 2**70, 1.5, "qpos", [1]])
def test_unknown_parts_of_a_state_are_refused(sig: Any, rows: int | None) -> None:
    physics = Physics.from_xml_string(_FILTERED)
    if rows is not None:
        physics = physics.replicate(rows, 1).physics
    for use in (physics.get_state, lambda sig: physics.set_state(np.ones(3), sig)):
        with pytest.raises((ValueError, TypeError), match=r"sig is .*; expected bits of mujoco"):
            use(sig)
    assert not physics.get_state().any()


def test_parts_of_a_state_are_bits_or_their_names() -> None:
    physics = Physics.from_xml_string(_FILTERED)
    assert physics.get_state(0).shape == (0,)
    assert physics.get_state(np.int64(_VELOCITY)).shape == (1,)  # pyright: ignore[reportArgumentType]
    assert physics.get_state(mujoco.mjtState.mjSTATE_QVEL).shape == (1,)  # pyright: ignore[reportArgumentType]
    whole = 2**mujoco.mjtState.mjNSTATE.value - 1
    physics.set_state(physics.get_state(whole), whole)


def test_a_subclass_may_name_other_parts_of_the_state() -> None:
    class Positions(Physics):
        def _physics_state_items(self) -> list[np.ndarray]:
            return [self.data.qpos]

    physics = Positions.from_xml_string(_FILTERED)
    physics.set_state(np.array([0.5]))
    assert physics.get_state().tolist() == [0.5]


def _actuated(actuators: str) -> Physics:
    return Physics.from_xml_string(_ACTUATED.format(actuators=actuators))


def test_bounds_are_those_of_limited_actuators_and_else_mujocos_maximum() -> None:
    spec = action_spec(_actuated(_ACTUATORS))
    assert spec.shape == (3,)
    assert spec.dtype == float
    np.testing.assert_array_equal(spec.minimum, [-2.0, -mujoco.mjMAXVAL, -mujoco.mjMAXVAL])
    np.testing.assert_array_equal(spec.maximum, [3.0, mujoco.mjMAXVAL, mujoco.mjMAXVAL])


def test_a_model_without_actuators_takes_an_empty_action() -> None:
    spec = action_spec(_actuated(""))
    assert spec.shape == (0,)
    assert spec.generate_value().shape == (0,)


def test_bounds_that_are_edited_are_those_of_the_next_spec_alone() -> None:
    physics = _actuated(_ACTUATORS)
    before = action_spec(physics)
    physics.model.actuator_ctrlrange[0] = -0.5, 0.25
    after = action_spec(physics)
    assert (before.minimum[0], before.maximum[0]) == (-2.0, 3.0)
    assert (after.minimum[0], after.maximum[0]) == (-0.5, 0.25)


# Targets of the quadruped's joints have ranges of their own, and lqr has no limits.
_OTHER_LIMITS = ("lqr", "quadruped")


@pytest.mark.parametrize("task", EVERY_TASK)
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


def test_rendering_a_batch_suggests_the_call_for_its_rows(physics: Physics) -> None:
    rows = physics.replicate(2, 1).physics
    with pytest.raises(
        TypeError, match=r"not support render\(\): call render\(rows, \.\.\.\) of its Batch"
    ):
        rows.render()
