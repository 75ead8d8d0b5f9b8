"""`solve`: the optimal policy and value of an LQR task.

    p, k, beta = solve(suite.load("lqr", "lqr_2_1"))
    action = k @ x      # x: positions, then velocities

The problem and its Riccati equation:
https://en.wikipedia.org/wiki/Linear-quadratic_regulator#Infinite-horizon,_discrete-time
"""

import mujoco
import numpy as np

from limberjack.rl import control

__all__ = ["solve"]

_ROUNDING = 1e-9  # what keeps its energy has an eigenvalue of 1, but for rounding
_MOST_DOUBLINGS = 50  # each doubles the horizon; a dozen suffice unless hardly anything is damped


def solve(env: control.Environment) -> tuple[np.ndarray, np.ndarray, float]:
    """The optimal value and policy of an LQR environment.

    Returns:
      p: (2n, 2n) for n joints; the total cost from a state x of positions and velocities on is
        x.p.x / 2.
      k: (nu, 2n); the optimal action is k.x.
      beta: the largest absolute eigenvalue of the controlled system, below 1: after t steps the
        state has shrunk at least as beta**t.

    Raises:
      RuntimeError: no linear policy makes the system stable.
    """
    model, data = env.physics.model.ptr, env.physics.data.ptr
    n, nu, timestep = model.nq, model.nu, model.opt.timestep
    mass = np.zeros((n, n))
    mujoco.mju_sym2dense(mass, data.M, model.M_rownnz, model.M_rowadr, model.M_colind)

    # One step of semi-implicit Euler: first the velocities change, then the positions.
    springs = np.hstack((np.diag(model.jnt_stiffness), np.diag(model.dof_damping)))
    change = np.linalg.solve(-mass, springs)
    drift = np.hstack((np.zeros((n, n)), np.eye(n)))
    a = np.eye(2 * n) + timestep * np.vstack((timestep * change + drift, change))
    push = np.linalg.solve(mass, np.eye(n, nu))
    b = timestep * np.vstack((timestep * push, push))

    q = np.diag(np.repeat((1.0, 0.0), n))
    r = env.task.control_cost_coef * np.eye(nu)
    p = _riccati(a, b, q, r)
    k = -np.linalg.solve(b.T @ p @ b + r, b.T @ p @ a)
    beta = np.abs(np.linalg.eigvals(a + b @ k)).max()
    if not beta < 1 - _ROUNDING:
        raise RuntimeError(f"the controlled system is unstable: its largest eigenvalue is {beta}")
    return p, k, beta


def _riccati(a: np.ndarray, b: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
    """The solution p of p = a.T (p - p b (b.T p b + r)^-1 b.T p) a + q.

    By the doubling algorithm of Chu, Fan, Lin & Wang (Int. J. Control 77, 2004): after i iterations
    p is the cost over 2**i steps.
    """
    g, p = b @ np.linalg.solve(r, b.T), q
    for _ in range(_MOST_DOUBLINGS):
        both = np.linalg.solve(np.eye(len(a)) + g @ p, np.hstack((a, g)))
        through, spread = both[:, : len(a)], both[:, len(a) :]
        before = p
        g, p, a = g + a @ spread @ a.T, p + a.T @ p @ through, a @ through
        if np.allclose(p, before, rtol=1e-15, atol=0):
            break
    return (p + p.T) / 2
