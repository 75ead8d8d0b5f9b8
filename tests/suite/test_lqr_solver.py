"""Tests of limberjack.suite.lqr_solver."""

from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.suite import lqr_solver

_TASKS = pytest.mark.parametrize("task", ["lqr_2_1", "lqr_6_2"])


def _total_cost(env: Any, k: np.ndarray, steps: int) -> float:
    """The cost of an episode with the policy u = k x."""
    step, total = env.reset(), 0.0
    for _ in range(steps):
        x = np.hstack((step.observation["position"], step.observation["velocity"]))
        step = env.step(k @ x)
        total += 1 - step.reward
        if step.last():
            break
    return total


@_TASKS
def test_the_cost_of_an_episode_is_the_one_computed_and_no_policy_nearby_is_cheaper(
    task: str,
) -> None:
    env = suite.load("lqr", task, {"random": 1})
    p, k, beta = lqr_solver.solve(env)
    x = np.hstack((env.reset().observation["position"], np.zeros(env.physics.model.nv)))
    steps = int(np.log(1e-6) / np.log(beta))
    stream = np.random.RandomState(0)
    costs = []
    for policy in (k, *(k * stream.uniform(0.9, 1.1, k.shape) for _ in range(5))):
        env.reseed(1)
        costs.append(_total_cost(env, policy, steps))
    # Rewards are of the state after a step; the value counts that of the start, which costs 1.
    assert costs[0] + 1 == pytest.approx(0.5 * x @ p @ x, rel=1e-6)
    assert costs[0] == min(costs)


@_TASKS
def test_under_the_optimal_policy_an_episode_ends_at_rest(task: str) -> None:
    env = suite.load("lqr", task, {"random": 2})
    _, k, beta = lqr_solver.solve(env)
    step = env.reset()
    for _ in range(int(2 * np.log(1e-7) / np.log(beta))):
        if step.last():
            break
        step = env.step(k @ np.hstack((step.observation["position"], step.observation["velocity"])))
    assert step.last()
    assert step.discount == 0.0
    assert env.task.get_evaluation(env.physics) == 1.0


def test_the_value_solves_the_riccati_equation() -> None:
    random = np.random.RandomState(0)
    for _ in range(20):
        a, b = random.randn(5, 5), random.randn(5, 2)
        q, r = np.diag(random.rand(5)), np.diag(random.rand(2) + 0.1)
        p = lqr_solver._riccati(a, b, q, r)
        gain = np.linalg.solve(b.T @ p @ b + r, b.T @ p @ a)
        np.testing.assert_allclose(p, a.T @ p @ (a - b @ gain) + q, rtol=1e-6, atol=1e-6 * p.max())
        np.testing.assert_array_equal(p, p.T)


def test_a_system_that_cannot_be_stabilised_is_an_error() -> None:
    env = suite.load("lqr", "lqr_2_1", {"random": 0})
    # The second ball is not held by a spring, and the first is accelerated by its velocity.
    env.physics.model.jnt_stiffness[:] = [20.0, 0.0]
    env.physics.model.dof_damping[:] = [-5.0, 0.0]
    with pytest.raises(RuntimeError, match="the controlled system is unstable"):
        lqr_solver.solve(env)
