"""Code shared by both kinds of simulations; see `limberjack.mujoco.simulation`."""

import logging

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Physics
from limberjack.mujoco.simulation import CountsWarnings, described, is_bad_state, read_field

_FREE = """
<mujoco>
  <worldbody><body><freejoint name="root"/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="root" gear="1 0 0 0 0 0"/></actuator>
</mujoco>
"""
_KINDS = len(mujoco.mjtWarning.__members__) - 1  # the last one is their number
_BAD_CONTROL = mujoco.mjtWarning.mjWARN_BADCTRL.value
_BAD_VELOCITY = mujoco.mjtWarning.mjWARN_BADQVEL.value


class _Counter(CountsWarnings):
    """Warning counters without a simulation, for one row or many."""

    def __init__(self, *rows: int) -> None:
        self.warnings = np.zeros((*rows, _KINDS), int)
        self._no_warnings = bytes(self.warnings.nbytes)


def test_without_warnings_nothing_is_set_aside_and_nothing_is_new() -> None:
    counter = _Counter()
    assert not counter.has_warned()
    assert counter.set_warnings_aside() is None
    assert counter.new_warnings(None) is None


def test_a_first_warning_is_new_and_stays_counted() -> None:
    counter = _Counter()
    earlier = counter.set_warnings_aside()
    counter.warnings[_BAD_CONTROL] = 2
    new = counter.new_warnings(earlier)
    assert new is not None
    assert np.flatnonzero(new).tolist() == [_BAD_CONTROL]
    assert counter.warnings[_BAD_CONTROL] == 2


def test_earlier_warnings_are_not_new_and_are_counted_again_afterwards() -> None:
    counter = _Counter(3)
    counter.warnings[1, _BAD_CONTROL] = 4
    earlier = counter.set_warnings_aside()
    assert not counter.has_warned()
    assert counter.new_warnings(earlier) is None
    assert counter.warnings[1, _BAD_CONTROL] == 4
    assert counter.warnings.sum() == 4


def test_the_same_number_of_the_same_warning_is_new_if_it_came_since() -> None:
    counter = _Counter(2)
    counter.warnings[0, _BAD_CONTROL] = 1
    earlier = counter.set_warnings_aside()
    counter.warnings[0, _BAD_CONTROL] = 1  # as MuJoCo counts after it has reset the simulation
    new = counter.new_warnings(earlier)
    assert new is not None
    assert np.argwhere(new).tolist() == [[0, _BAD_CONTROL]]
    assert counter.warnings[0, _BAD_CONTROL] == 2


def test_a_description_has_the_kinds_and_of_a_batch_the_rows() -> None:
    warnings = np.zeros(_KINDS, bool)
    warnings[[_BAD_CONTROL, _BAD_VELOCITY]] = True
    assert set(described(warnings).split(", ")) == {"mjWARN_BADCTRL", "mjWARN_BADQVEL"}
    rows = np.zeros((4, _KINDS), bool)
    rows[3, _BAD_VELOCITY] = rows[1, _BAD_VELOCITY] = True
    assert described(rows) == "mjWARN_BADQVEL in rows [1, 3]"


def _state(physics: Physics) -> np.ndarray:
    return physics.get_state(mujoco.mjtState.mjSTATE_INTEGRATION.value)


@pytest.mark.parametrize(
    ("value", "is_bad"),
    [
        (0.0, False),
        (mujoco.mjMAXVAL, False),
        (-mujoco.mjMAXVAL, False),
        (np.nextafter(mujoco.mjMAXVAL, np.inf), True),
        (np.nan, True),
        (-np.inf, True),
    ],
)
@pytest.mark.parametrize("part", ["qpos", "qvel"])
@pytest.mark.parametrize("index", [0, -1])
def test_a_state_is_bad_where_mujoco_would_replace_it(
    value: float, is_bad: bool, part: str, index: int
) -> None:
    physics = Physics.from_xml_string(_FREE)
    getattr(physics.data, part)[index] = value
    official = physics.model._official
    assert is_bad_state(official, _state(physics)) == is_bad
    kind = "mjWARN_BADQPOS" if part == "qpos" else "mjWARN_BADQVEL"
    mujoco.mj_checkPos(official, physics.data._data)
    mujoco.mj_checkVel(official, physics.data._data)
    assert bool(physics.simulation.warnings[mujoco.mjtWarning.__members__[kind].value]) == is_bad


def test_time_controls_and_accelerations_do_not_make_a_state_bad() -> None:
    physics = Physics.from_xml_string(_FREE)
    physics.data.time = np.inf
    physics.data.ctrl[:] = np.nan
    physics.data.qacc_warmstart[:] = np.nan
    assert not is_bad_state(physics.model._official, _state(physics))


def test_states_are_judged_row_by_row() -> None:
    physics = Physics.from_xml_string(_FREE)
    states = np.tile(_state(physics), (2, 3, 1))
    states[0, 2, 1] = np.nan
    states[1, 0, 1 + physics.model.nq] = np.inf
    expected = [[False, False, True], [True, False, False]]
    assert is_bad_state(physics.model._official, states).tolist() == expected


def test_fields_are_read_live_with_those_of_the_options() -> None:
    model = mujoco.MjModel.from_xml_string(_FREE)
    mass, gravity = read_field(model, "body_mass"), read_field(model, "opt.gravity")
    assert isinstance(mass, np.ndarray)
    assert isinstance(gravity, np.ndarray)
    model.body_mass[1], model.opt.gravity[2] = 7.0, -1.0
    assert (mass[1], gravity[2]) == (7.0, -1.0)
    for name in ("body_mas", "opt.gravty"):
        with pytest.raises(AttributeError):
            read_field(model, name)


def test_mujocos_warnings_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    physics = Physics.from_xml_string(_FREE)
    physics.data.qvel[:] = np.nan
    with caplog.at_level(logging.WARNING, "limberjack"):
        physics.simulation.step(2)
    assert any("simulation is unstable" in record.getMessage() for record in caplog.records)
    assert {record.name for record in caplog.records} == {"limberjack"}
