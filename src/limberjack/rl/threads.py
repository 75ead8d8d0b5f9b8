"""`threads_for`: the number of threads that step a batch.

    threads_for(None, 1024, environment)     # as many as the work of a step can occupy

Waking a thread takes longer than a step of a few pendulums: for these, one thread is faster than
two. The number of threads changes no bit of the results.
"""

import time

import mujoco

from limberjack.rl import control
from limberjack.rl.guards import at_least_one
from limberjack.utils.cores import usable_cores

__all__ = ["threads_for"]

# Work of a step, in microseconds, from which a further thread pays: several times what waking it
# takes. Measured with pendulum and reacher (`benchmarks/suite_speed.py --only threads`).
_WORTH_A_THREAD = 200.0
_TIMINGS = 5  # of a step, of which the fastest counts


def threads_for(num_threads: int | None, num_envs: int, environment: control.Environment) -> int:
    """The number of threads that step the rows, at most one for each.

    Args:
      num_threads: the user's choice; None for as many cores as the work of a step can occupy.
      num_envs: number of rows.
      environment: one of the environments; it is not changed.

    Raises:
      ValueError: `num_threads` is not a whole number of at least 1.
    """
    if num_threads is not None:
        return min(at_least_one("num_threads", num_threads), num_envs)
    cores = min(usable_cores(), num_envs)
    if cores == 1:
        return 1
    work = num_envs * _microseconds_per_step(environment)
    return max(1, min(cores, int(work / _WORTH_A_THREAD)))


def _microseconds_per_step(environment: control.Environment) -> float:
    """The time of a step of the same model from its default pose."""
    model = environment.physics.model._model
    data, taken = mujoco.MjData(model), []
    for _ in range(_TIMINGS):
        start = time.perf_counter()
        mujoco.mj_step(model, data, environment._n_sub_steps)
        taken.append(time.perf_counter() - start)
    return 1e6 * min(taken)
