"""The forecast of an object's poses."""

import numpy as np
import pytest

from limberjack import suite
from limberjack.planner import cost_for
from limberjack.planner.arm.hand import ARM
from limberjack.planner.manipulator.bring import Bring
from limberjack.planner.manipulator.forecast import MEETS, restored
from limberjack.rl.control import PhysicsError

from .scenes import scene


def test_a_ball_moves_as_predicted_while_the_arm_stays() -> None:
    for seed in (1000, 1002, 1012):
        env = suite.load("manipulator", "bring_ball", task_kwargs={"random": seed})
        env.reset()
        physics, cost = env.physics.copy(), Bring(env.task)
        data, kept = physics.named.data, env.physics.named.data.qpos[ARM].copy()
        data.qvel["ball_x"] = 0.5
        cost.update(physics)
        places = [place for place, _ in cost._fetch.forecast.poses]
        assert len(places) == cost.settings.knots - 1
        for expected in places:
            for _ in range(round(0.125 / physics.timestep())):
                physics.step()
                data.qpos[ARM], data.qvel[ARM] = kept, 0.0
            physics.forward()
            # The same, unless the ball touches the arm: one that is put back after each time step
            # gives way a little, by 2 mm here.
            np.testing.assert_allclose(data.site_xpos["ball"], expected, rtol=0, atol=0.005)


@pytest.mark.parametrize("allowed", [0, 2])
def test_a_ball_is_fetched_from_the_last_pose_before_the_simulation_diverges(
    monkeypatch: pytest.MonkeyPatch, allowed: int
) -> None:
    env = suite.load("manipulator", "bring_ball", task_kwargs={"random": 1000})
    env.reset()
    physics = env.physics.copy()
    physics.named.data.qvel["ball_x"] = 0.5
    state, step, calls = physics.get_state(), physics.step, []
    armature = physics.model.dof_armature.copy()

    def fails_later(nstep: int = 1) -> None:
        calls.append(nstep)
        if len(calls) > allowed:
            raise PhysicsError("diverged")
        step(nstep)

    monkeypatch.setattr(physics, "step", fails_later)
    cost = cost_for(env.task)
    cost.update(physics)
    found = cost.proposals(physics, np.random.default_rng(0))
    assert len(calls) == allowed + 1
    assert found is not None
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(physics.get_state(), state)
    np.testing.assert_array_equal(physics.model.dof_armature, armature)


def test_an_object_at_rest_is_met_where_it_is_and_a_moving_one_at_the_knots() -> None:
    cost, physics = scene("bring_ball", 1000, [0.0, 0.7, 0.7, 0.7], [0.1, 0.022, 0.0])
    data, forecast = physics.named.data, cost._fetch.forecast
    forecast.update(physics)
    assert forecast.settles
    assert forecast.poses == []
    ((place, _),) = forecast.met(data)
    np.testing.assert_array_equal(place, data.site_xpos["ball"])
    data.qvel["ball_x"] = 0.5
    forecast.update(physics)
    assert len(forecast.met(data)) == len(MEETS)


def test_a_simulation_that_was_tried_is_restored() -> None:
    _, physics = scene("bring_ball", 1000, [0.0, 0.7, 0.7, 0.7], [0.0, 0.3, 0.0])
    data = physics.named.data
    physics.set_control(np.full(5, 0.5))
    physics.forward()
    before = [physics.get_state(), data.ctrl[:], data.site_xpos["ball"], physics.time()]
    before = [np.copy(value) for value in before]
    with restored(physics):
        physics.set_control(np.zeros(5))
        physics.step(10)
        assert data.site_xpos["ball"][2] < 0.3
    after = [physics.get_state(), data.ctrl[:], data.site_xpos["ball"], physics.time()]
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(new, old)
