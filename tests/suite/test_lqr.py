"""Tests of limberjack.suite.lqr."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite import lqr


def set_state(physics: Any, position: Any, velocity: Any = 0.0) -> None:
    """Puts the balls somewhere, without controls."""
    with physics.reset_context():
        physics.data.qpos[:] = position
        physics.data.qvel[:] = velocity


def test_the_reward_is_one_less_the_squares_of_positions_and_controls() -> None:
    env = suite.load("lqr", "lqr_6_2")
    for position, control, reward in [
        (0.0, 0.0, 1.0),
        ([1, 0, 0, 0, 0, -1], 0.0, 0.0),
        (2.0, 0.0, -11.0),
        (0.0, [1.0, -1.0], 0.9),
        ([0, 0, 0, 0, 0, 10], [3.0, 4.0], -50.25),
    ]:
        set_state(env.physics, position, velocity=5.0)  # velocities cost nothing
        env.physics.set_control(control)
        assert env.task.get_reward(env.physics) == pytest.approx(reward)


@pytest.mark.parametrize(
    ("norm", "evaluation", "termination"),
    [(2.0, 0.0, None), (0.02, 0.0, None), (0.005, 1.0, None), (2e-6, 1.0, None), (5e-7, 1.0, 0.0)],
)
def test_an_episode_ends_at_rest(norm: float, evaluation: float, termination: Any) -> None:
    env = suite.load("lqr", "lqr_2_1")
    set_state(env.physics, [0.6 * norm, 0.0], [0.0, -0.8 * norm])
    assert env.physics.state_norm() == pytest.approx(norm)
    assert env.task.get_evaluation(env.physics) == evaluation
    assert env.task.get_termination(env.physics) == termination


def test_an_episode_at_rest_ends_with_discount_0_in_its_own_row_only() -> None:
    env = suite.load("lqr", "lqr_2_1", {"random": 0})
    assert env.step_limit is None
    batch = BatchEnvironment.from_environment(env, 3)
    batch.reset(), env.reset()
    set_state(env.physics, 0.0)
    batch.physics.data.qpos[1] = 0.0
    batched, single = batch.step(np.zeros((3, 1))), env.step([0.0])
    assert single.last()
    assert single.discount == 0.0
    assert batched.discount.tolist() == [1.0, 0.0, 1.0]
    assert batch.begins.tolist() == [False, True, False]
    assert not batch.timed_out.any()
    np.testing.assert_array_equal(batch.task.get_evaluation(batch.physics), [0.0, 1.0, 0.0])


def test_a_start_is_at_rest_on_a_sphere() -> None:
    env = suite.load("lqr", "lqr_6_2", {"random": 0})
    starts = []
    for _ in range(50):
        env.reset()
        assert not env.physics.velocity().any()
        starts.append(env.physics.position())
    np.testing.assert_allclose(np.linalg.norm(starts, axis=-1), np.sqrt(2))
    assert (np.min(starts, axis=0) < -0.5).all()
    assert (np.max(starts, axis=0) > 0.5).all()


def test_springs_are_drawn_from_their_range_without_damping() -> None:
    drawn = []
    for seed in range(30):
        model = suite.load("lqr", "lqr_6_2", {"random": seed}).physics.model
        drawn.append(model.jnt_stiffness[:].copy())
        assert not model.dof_damping.any()
    assert 15 <= np.min(drawn) < 16
    assert 24 < np.max(drawn) <= 25


@pytest.mark.parametrize(("bodies", "actuators"), [(1, 1), (3, 2), (6, 2), (9, 9)])
def test_the_model_that_is_given_has_the_springs_that_the_task_draws(
    bodies: int, actuators: int
) -> None:
    made = lqr.get_model_and_assets(bodies, actuators, np.random.RandomState(4))
    model = lqr.Physics.from_xml_string(*made).model
    assert (model.nq, model.nu, model.ntendon) == (bodies, actuators, bodies - 1)
    task = lqr.LQRLevel(0.1, drawn_springs=bodies)
    stream = np.random.RandomState(4)
    springs = task.begin_stream(stream)["jnt_stiffness"]
    np.testing.assert_array_equal(model.jnt_stiffness, springs)
    assert stream.rand() == np.random.RandomState(4).rand(2 * bodies + 1)[-1]  # damping is drawn


_STREAM = np.random.RandomState(0)


@pytest.mark.parametrize(
    ("numbers", "error", "message"),
    [
        ((0, 1), ValueError, "n_bodies is 0; expected a whole number from 1 to"),
        ((2, 0), ValueError, "n_actuators is 0; expected a whole number from 1 to"),
        ((2, 3), ValueError, "n_actuators is 3; expected at most n_bodies, 2"),
        ((10**4, 1), ValueError, "n_bodies is 10000; expected a whole number from 1 to"),
        (("2", 1), TypeError, "n_bodies is '2'; expected a whole number from 1 to"),
        ((2.5, 1), TypeError, "n_bodies is 2.5; expected"),
        ((2, None), TypeError, "n_actuators is None; expected"),
    ],
)
def test_a_chain_that_cannot_be_built_is_refused(
    numbers: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        lqr.get_model_and_assets(numbers[0], numbers[1], _STREAM)


@pytest.mark.parametrize(
    ("coefficient", "error"),
    [(0, ValueError), (-0.1, ValueError), (np.nan, ValueError), ("0.1", TypeError)],
)
def test_a_cost_that_is_not_positive_is_refused(coefficient: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match=r"control_cost_coef is .*; expected a positive number"):
        lqr.LQRLevel(coefficient)
    assert lqr.LQRLevel(0.5).control_cost_coef == 0.5
