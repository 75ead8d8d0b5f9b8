"""`open_workers`: this process, other processes, an executor or Ray, with one interface.

with open_workers(workers=4) as workers:
    for unit, result in workers.results(function, units):
        ...
"""

import concurrent.futures
import contextlib
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

from limberjack.rl.guards import at_least_one
from limberjack.utils.cores import usable_cores
from limberjack.workers.attempt import Function, WorkError
from limberjack.workers.executors import ExecutorWorkers
from limberjack.workers.pool import Pool
from limberjack.workers.state import OnState
from limberjack.workers.units import Unit

__all__ = ["Workers", "open_workers"]

_Result = TypeVar("_Result")


class Workers(Protocol):
    """Anything that plays units."""

    def results(
        self, function: Function[_Result], units: Iterable[Unit]
    ) -> Iterator[tuple[Unit, _Result]]:
        """The units with their results, in the order in which they end.

        Args:
          function: of a setup and seeds, at the top level of a module, or a `partial` of one; its
            result depends on these alone.
          units: each is played once, or again if its worker is lost.

        Raises:
          WorkError: a unit failed, or workers were lost or refused. Earlier results are complete.
        """
        ...

    def close(self) -> None:
        """Ends the workers, in the middle of units too."""


@contextlib.contextmanager
def open_workers(
    workers: int | None = None,
    *,
    executor: concurrent.futures.Executor | None = None,
    ray: str | None = None,
    on_state: OnState | None = None,
) -> Iterator[Workers]:
    """Workers for the time of the context.

    Args:
      workers: number of processes; with an executor, units that it runs at a time, by default one
        per usable core. None without an executor or Ray plays in this process.
      executor: any `concurrent.futures.Executor`; it is not shut down.
      ray: address of a Ray cluster, or 'local' to start one on this machine.
      on_state: called as units begin and end.

    Raises:
      ValueError, TypeError: `workers` is no number of workers, the executor forks, or both an
        executor and Ray are given.
      WorkError: Ray is not installed, or there is no cluster at that address.
    """
    if workers is not None:
        at_least_one("workers", workers)
    if executor is not None and ray is not None:
        raise ValueError("executor and ray are both given; expected one of them")
    with contextlib.closing(_opened(workers, executor, ray, on_state)) as opened:
        yield opened


def _opened(
    workers: int | None,
    executor: concurrent.futures.Executor | None,
    ray: str | None,
    on_state: OnState | None,
) -> Workers:
    if ray is not None:
        try:
            from limberjack.workers.ray_tasks import RayTasks
        except ImportError as error:
            raise WorkError(f"ray {error}") from None
        return RayTasks(ray, workers, on_state)
    if executor is not None:
        return ExecutorWorkers(executor, workers or usable_cores(), on_state)
    return _Here() if workers is None else Pool(workers, on_state)


class _Here:
    """This process, which plays one unit after the other; errors are raised as they are."""

    def results(
        self, function: Function[_Result], units: Iterable[Unit]
    ) -> Iterator[tuple[Unit, _Result]]:
        """The units with their results, in their order."""
        for unit in units:
            yield unit, function(unit.setup, unit.seeds)

    def close(self) -> None:
        """Does nothing."""
