"""Units in any `concurrent.futures.Executor`: a process pool, Dask's, mpi4py's; and submitit's.

    with concurrent.futures.ProcessPoolExecutor(4, mp_context=get_context("spawn")) as executor:
        for unit, result in ExecutorWorkers(executor, 4).results(function, units):
            ...

The executor belongs to the caller, and is not shut down here.
"""

import concurrent.futures
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from limberjack.workers.attempt import Answer, Failed, Function, WorkError, attempt, value_of
from limberjack.workers.state import OnState, State
from limberjack.workers.units import Unit, queue_of

__all__ = ["ExecutorWorkers", "in_flight"]

_LOOK = 0.2  # seconds between two checks of jobs that cannot be waited for
_IN_FLIGHT = 2  # units per worker: one is played, one waits for it

_Result = TypeVar("_Result")
_Job = TypeVar("_Job")


def in_flight(
    units: Iterable[Unit],
    workers: int,
    running: dict[_Job, Unit],
    submit: Callable[[Unit], _Job],
    ended: Callable[[], Iterable[_Job]],
    value: Callable[[_Job, Unit], _Result],
) -> Iterator[tuple[Unit, _Result]]:
    """The units with their results, submitted as earlier ones end.

    Args:
      units: each is submitted once; see `Workers.results`.
      workers: the number of units that are played at a time.
      running: takes the jobs that have been submitted and have not ended.
      submit: submits a unit.
      ended: waits a while; returns jobs that have ended.
      value: the result of such a job.
    """
    waiting = queue_of(units)
    while waiting or running:
        while waiting and len(running) < _IN_FLIGHT * workers:
            unit = waiting.popleft()
            running[submit(unit)] = unit
        for job in ended():
            unit = running.pop(job)
            yield unit, value(job, unit)


class ExecutorWorkers:
    """Units submitted to an executor."""

    def __init__(
        self,
        executor: concurrent.futures.Executor,
        workers: int,
        on_state: OnState | None = None,
    ) -> None:
        """Takes an executor and the number of units that it runs at a time.

        Raises:
          TypeError: it is something else.
          ValueError: it forks.
        """
        if not callable(getattr(executor, "submit", None)):
            raise TypeError(
                f"executor is of type {type(executor).__name__}; expected a "
                "concurrent.futures.Executor, such as a ProcessPoolExecutor"
            )
        context = getattr(executor, "_mp_context", None)
        if context is not None and context.get_start_method() == "fork":
            raise ValueError(
                "executor forks this process, in which MuJoCo's batches cannot be used: pass "
                "mp_context=multiprocessing.get_context('spawn') to it"
            )
        self._executor = executor
        self._workers = workers
        self._on_state = on_state
        self._running: dict[concurrent.futures.Future, Unit] = {}

    def results(
        self, function: Function[_Result], units: Iterable[Unit]
    ) -> Iterator[tuple[Unit, _Result]]:
        """The units with their results, in the order in which they end.

        Raises:
          WorkError: a unit failed, or the executor broke.
        """

        def submit(unit: Unit) -> concurrent.futures.Future[Answer[_Result] | Failed]:
            try:
                return self._executor.submit(attempt, function, unit.setup, unit.seeds, *unit.more)
            except RuntimeError as error:  # it has broken or is shut down
                raise _broken(error) from error

        try:
            yield from in_flight(units, self._workers, self._running, submit, self._ended, _value)
        finally:
            self.close()

    def close(self) -> None:
        """Cancels the units that have not begun."""
        for future in self._running:
            future.cancel()
        self._running.clear()

    def _ended(self) -> list[concurrent.futures.Future]:
        """Reports the state, and waits until a job has ended; returns all that have."""
        running = self._running
        if self._on_state is not None:
            self._on_state(State(self._workers, min(self._workers, len(running))))
        if all(isinstance(future, concurrent.futures.Future) for future in running):
            first = concurrent.futures.FIRST_COMPLETED
            return list(concurrent.futures.wait(running, return_when=first).done)
        while not (ended := [job for job in running if job.done()]):  # submitit's jobs
            time.sleep(_LOOK)
        return ended


def _value(future: concurrent.futures.Future[Answer[_Result] | Failed], unit: Unit) -> _Result:
    try:
        answer = future.result()
    except Exception as error:  # as it broke, or cancelled the job
        raise _broken(error) from error
    return value_of(answer)


def _broken(error: BaseException) -> WorkError:
    text = " ".join(str(error).split())
    return WorkError(f"the executor failed ({type(error).__name__}{text and f': {text}'})")
