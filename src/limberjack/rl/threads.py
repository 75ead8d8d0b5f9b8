"""The number of threads that step a batch, and `RowThreads`, which do a job for each row.

    threads_for(None, 1024, environment)    # as many as the work of a step can occupy
    threads = RowThreads(num_rows=64, num_threads=2)
    errors = threads.each(step_row)         # step_row(row) for all rows; returns when all are done
    errors = threads.share(job, rows, num_threads=2)

Waking a thread takes longer than a step of a few pendulums: for these, one thread is faster than
two. The number of threads changes no bit of the results.

With `each`, each row keeps its thread, so what a row's environment keeps per thread stays valid.
With `share`, which takes less time, the job must not depend on the thread. A thread runs
in the caller's context, for `np.errstate`. With one thread the caller steps the rows, in order. The
threads belong to `concurrent.futures`, so that the interpreter joins them before it exits. They
start with the first use, and again after a fork or in a copy. No signature names their class, which
cannot be imported while the interpreter exits.
"""

import concurrent.futures
import contextvars
import itertools
import os
import time
from collections.abc import Callable, Iterable, Sequence

import mujoco
import numpy as np

from limberjack.rl import control
from limberjack.rl.guards import at_least_one
from limberjack.utils.cores import usable_cores

__all__ = ["RowErrors", "RowThreads", "interrupts", "run", "threads_for"]

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
    model = environment.physics.model._official
    data, taken = mujoco.MjData(model), []
    for _ in range(_TIMINGS):
        start = time.perf_counter()
        mujoco.mj_step(model, data, environment._n_sub_steps)
        taken.append(time.perf_counter() - start)
    return 1e6 * min(taken)


RowErrors = list[tuple[int, BaseException]]


class RowThreads:
    """See the module's docstring."""

    def __init__(self, num_rows: int, num_threads: int) -> None:
        self.num_threads = num_threads
        self._num_rows = num_rows
        bounds = np.linspace(0, num_rows, num_threads + 1).round().astype(int).tolist()
        self._shares = list(itertools.pairwise(bounds))
        self._forget()

    def _forget(self) -> None:
        self._process = os.getpid()
        self._threads: list[concurrent.futures.ThreadPoolExecutor] = []

    def each(self, job: Callable[[int], object], rows: Sequence[int] | None = None) -> RowErrors:
        """Calls `job(row)` for rows, all by default; returns the errors, by row.

        Every row is tried. An interrupt of the caller is raised once all threads have returned.
        """
        if rows is None:
            rows = range(self._num_rows)
        if self.num_threads == 1 or not rows:
            return run(job, rows)
        shares = [[row for row in rows if first <= row < end] for first, end in self._shares]
        given = zip(self._living(), shares, strict=True)
        return self._run_in([(thread, share) for thread, share in given if share], job, ())

    def share(
        self, job: Callable[[int], object], rows: Sequence[int], num_threads: int
    ) -> RowErrors:
        """Calls `job(row)` for rows, each in any of a few threads that is free; returns the errors.

        The caller's thread is one of them. An interrupt there is returned as an error of the row.
        """
        if num_threads == 1 or len(rows) < 2:
            return run(job, rows)
        rest = iter(rows)  # of all threads together
        return self._run_in([(one, rest) for one in self._living()[1:num_threads]], job, rest)

    def _living(self) -> Sequence[concurrent.futures.Executor]:
        """The threads, which are started if necessary."""
        if self._process != os.getpid():  # forked: threads stay in the parent
            self._forget()
        if not self._threads:
            threads = [
                concurrent.futures.ThreadPoolExecutor(1, f"limberjack-rows-{number}")
                for number in range(self.num_threads)
            ]
            # Start now: an executor interrupted as it starts its thread would start a second one.
            for thread in threads:
                thread.submit(int).result()
            self._threads = threads
        return self._threads

    def _run_in(
        self,
        given: Sequence[tuple[concurrent.futures.Executor, Iterable[int]]],
        job: Callable[[int], object],
        own: Iterable[int],
    ) -> RowErrors:
        """Runs a job in threads, for the rows given to each, and in this one for its own rows."""
        try:
            started = []
            for thread, rows in given:
                context = contextvars.copy_context()
                started.append(thread.submit(context.run, run, job, rows))
            errors = run(job, own)
            return errors + [error for future in started for error in future.result()]
        except BaseException:  # an interrupt of the caller, while the threads continue
            self._wait()
            raise

    def _wait(self) -> None:
        """Waits until the threads have done all they were given, through interrupts too."""
        for thread in self._threads:
            while True:
                try:
                    # A job of an interrupted `submit` may be queued; this one runs after it.
                    thread.submit(int).result()
                    break
                except KeyboardInterrupt:
                    continue

    def close(self) -> None:
        """Ends the threads."""
        if self._process == os.getpid():
            for thread in self._threads:
                thread.shutdown()
        self._forget()

    def __reduce__(self) -> tuple[type["RowThreads"], tuple[int, int]]:
        return type(self), (self._num_rows, self.num_threads)


def interrupts(errors: RowErrors) -> bool:
    """Whether an interrupt, or the user's exit, is among errors."""
    return any(not isinstance(error, Exception) for _, error in errors)


def run(job: Callable[[int], object], rows: Iterable[int]) -> RowErrors:
    """Calls `job(row)` for rows in this thread, until an interrupt; returns the errors, by row."""
    errors: RowErrors = []
    for row in rows:
        try:
            job(row)
        except BaseException as error:  # of any class: it is the user's code
            errors.append((row, error))
            if not isinstance(error, Exception):  # an interrupt, or the user's exit
                break
    return errors
