"""Servos that are built into a plan's model do what the law does."""

from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import Settings
from limberjack.planner.control_law import ControlLaw
from limberjack.planner.rollouts import Rollouts
from limberjack.planner.servos import Servos

_ROWS, _STEPS = 3, 6
_SETTINGS = Settings(gain=2.0, damping=0.1, tendons=True)


def _targets(law: ControlLaw, count: int = _ROWS) -> np.ndarray:
    drawn = np.random.default_rng(1).uniform(-0.5, 0.5, (_STEPS, count, len(law.low)))
    return law.within_limits(drawn)


def _batch(
    task: tuple[str, str], law: ControlLaw | None = None, states: int = 1
) -> tuple[Rollouts, Servos | None]:
    """A batch whose time step is the control step, in the starts of an episode each."""
    env = suite.load(*task, {"random": 0})
    twin = env.physics.copy()
    twin.model.opt.timestep = env.control_timestep()
    servos = None if law is None else Servos(twin.model.ptr, law)
    batch = Rollouts(twin, _ROWS, 2, getattr(env.task, "EPISODE_FIELDS", ()), states)
    saved = []
    for seed in range(_ROWS):
        start = suite.load(*task, {"random": seed})
        start.reset()
        saved.append(start.snapshot().physics)
    batch.simulation.load({n: np.concatenate([s[n] for s in saved]) for n in saved[0]})
    return batch, servos


def _law(task: tuple[str, str]) -> ControlLaw:
    return ControlLaw(suite.load(*task).physics.model._official, _SETTINGS)


def _plan(targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A spline with a knot at each step, (steps, rows, nu) -> its knots, and the steps' places."""
    return targets.swapaxes(0, 1), np.arange(float(len(targets)))


def _arm(states: int = 1) -> tuple[ControlLaw, Rollouts, Servos]:
    task = ("manipulator", "bring_ball")
    law = _law(task)
    batch, servos = _batch(task, law, states)
    assert servos is not None
    return law, batch, servos


def _read(seen: Any) -> dict[str, np.ndarray]:
    data = seen.data
    names = ["qpos", "qvel", "ctrl", "time", "xpos", "site_xmat"]
    return {name: np.array(getattr(data, name)) for name in names}


@pytest.mark.parametrize("task", [("humanoid", "walk"), ("manipulator", "bring_ball")])
def test_servos_do_what_the_law_does(task: tuple[str, str]) -> None:
    law = _law(task)
    targets = _targets(law)
    states = _STEPS // 2
    (by_law, _), (by_servos, servos) = _batch(task, None, states), _batch(task, law, states)
    assert servos is not None
    for follower, batch in ((law, by_law), (servos, by_servos)):
        _read(batch.seen)  # says what is to be noted
        diverged = follower.follow(batch, *_plan(targets), substeps=1, interval=2)
        assert diverged.shape == (_ROWS,)
        assert not diverged.any()
    expected, found = _read(by_law.seen), _read(by_servos.seen)
    for name, values in expected.items():
        # A servo rounds otherwise than the law: gain * target - (gain / gear) * (gear * angle).
        # After six steps that is 1e-11; a gain that is off by a thousandth makes 1e-3.
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-9, err_msg=name)
    assert np.abs(expected["ctrl"]).max() == 1  # the limits were reached


def test_the_last_state_is_looked_at_last_and_others_at_equal_distances() -> None:
    law, batch, servos = _arm(states=2)
    start = batch.physics.data.time.copy()
    batch.seen.data.time  # noqa: B018  # says that it is to be noted
    servos.follow(batch, *_plan(_targets(law)), substeps=3, interval=4)
    steps = np.array([2, 6]) * 3  # of time
    expected = start + 0.01 * steps[:, None]
    # MuJoCo adds the time steps one by one.
    np.testing.assert_allclose(batch.seen.data.time.reshape(2, _ROWS), expected, rtol=0, atol=1e-12)


def test_who_diverges_is_told_and_the_others_do_not_notice() -> None:
    ends = []
    for speed in (0.0, 1e9):
        law, batch, servos = _arm()
        batch.physics.data.qvel[1] += speed
        diverged = servos.follow(batch, *_plan(_targets(law)), 2, _STEPS)
        assert diverged.tolist() == [False, speed > 0, False]
        ends.append(batch.physics.data.qpos[[0, 2]].copy())
    np.testing.assert_array_equal(*ends)


def test_what_cannot_be_recorded_is_named() -> None:
    law, batch, servos = _arm()
    batch.seen.data.state  # noqa: B018
    with pytest.raises(ValueError, match=r"step_cost reads .*state.*plan without Settings\(servos"):
        servos.follow(batch, *_plan(_targets(law)), 1, _STEPS)


_ARM = """
<mujoco>
  <worldbody><body><joint name="hinge" axis="0 1 0"/><geom size=".1"/></body></worldbody>
  <actuator><{} joint="hinge"/></actuator>
</mujoco>
"""


def _servo(actuator: str) -> mujoco.MjModel:
    model = mujoco.MjModel.from_xml_string(_ARM.format(actuator))
    Servos(model, ControlLaw(model, Settings(gain=2.0, damping=0.5)))
    return model


def test_a_servo_has_the_motors_strength_gear_and_limits() -> None:
    motor = 'motor gear="4" ctrllimited="true" ctrlrange="-1 3"'
    model = _servo(motor)
    assert model.actuator_gainprm[0, 0] == 2
    assert model.actuator_biasprm[0, :3].tolist() == [0, -0.5, -0.125]
    assert model.actuator_forcerange[0].tolist() == [-1, 3]
    assert model.actuator_forcelimited[0]
    assert not model.actuator_ctrllimited[0]
    narrow = _servo(f'{motor} forcelimited="true" forcerange="-9 2"')
    assert narrow.actuator_forcerange[0].tolist() == [-1, 2]
    assert not _servo("motor").actuator_forcelimited[0]


@pytest.mark.parametrize(
    "actuator",
    ['general dyntype="filter" dynprm=".1"', 'motor gear="0"', 'general gainprm="0"'],
)
def test_a_motor_with_dynamics_or_without_effect_cannot_be_a_servo(actuator: str) -> None:
    with pytest.raises(ValueError, match=r"actuator 0 is no motor .* without Settings"):
        _servo(actuator)
