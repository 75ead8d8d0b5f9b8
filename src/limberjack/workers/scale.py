"""`open_workers`: this process, other processes, an executor or Ray, with one interface.

    with open_workers(workers=4) as workers:
        for unit, result in workers.results(function, units): ...

`Scale`: the number and kind of workers that a caller asked for, and what is used by default.

    scale = Scale(workers=4)
    setup = scale.setup(factory, environment, actor, "planner", episodes=100)
    if setup is not None:                   # None: this process plays
        with scale.open(episodes=100) as workers: ...

By default the planner plays one episode per core, each with one thread; other policies play in
batches, in this process, on all cores.
"""

import concurrent.futures
import contextlib
import dataclasses
from collections.abc import Iterable, Iterator
from typing import Protocol, TypeVar

import dm_env

from limberjack.policies import Actor
from limberjack.policies.built_in import PLANNER
from limberjack.rl.guards import at_least_one
from limberjack.utils.cores import usable_cores
from limberjack.workers.attempt import Function, WorkError
from limberjack.workers.executors import ExecutorWorkers
from limberjack.workers.factories import Factory
from limberjack.workers.pool import Pool
from limberjack.workers.setup import Setup, setup_of
from limberjack.workers.state import OnState
from limberjack.workers.units import Unit, queue_of

__all__ = ["Scale", "Workers", "open_workers"]


_Result = TypeVar("_Result")


class Workers(Protocol):
    """Anything that plays units."""

    def results(
        self, function: Function[_Result], units: Iterable[Unit]
    ) -> Iterator[tuple[Unit, _Result]]:
        """The units with their results, in the order in which they end.

        Args:
          function: of a setup, seeds and what else a unit has, at the top level of a module, or a
            `partial` of one; its result depends on these alone.
          units: each is played once, or again if its worker is lost. A `deque` may be added to
            while its results are read.

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


@dataclasses.dataclass(frozen=True)
class Scale:
    """Arguments of `open_workers`, as a caller gave them.

    Attributes:
      workers: number of processes, or of units that an executor or Ray plays at a time.
      executor: plays the units instead.
      ray: address of a Ray cluster, or 'local'.
      num_threads: of this process, or of each worker.
      any_processor: accept workers whose processors round differently.
      on_state: called with the state of the workers.
      vectorised: see `rl.batch_of`.
    """

    workers: int | None = None
    executor: concurrent.futures.Executor | None = None
    ray: str | None = None
    num_threads: int | None = None
    any_processor: bool = False
    on_state: OnState | None = None
    vectorised: bool | None = None

    def __post_init__(self) -> None:
        """Raises ValueError or TypeError unless the numbers are whole and at least 1."""
        for name in ("workers", "num_threads"):
            value = getattr(self, name)
            if value is not None:
                at_least_one(name, value)

    def setup(
        self,
        factory: Factory,
        environment: dm_env.Environment,
        actor: Actor,
        policy: object,
        episodes: int,
        action_repeat: int = 1,
    ) -> Setup | None:
        """The setup for workers; None if this process is to play.

        Args:
          factory, environment, actor, policy, action_repeat: see `workers.setup.setup_of`.
          episodes: their number.

        Raises:
          ValueError, TypeError: as `setup_of`, unless workers are used only by default.
        """
        is_planner = isinstance(policy, str) and policy == PLANNER
        suggests_itself = is_planner and self.num_threads is None and self._processes(episodes) > 1
        if not self._is_asked_for and not suggests_itself:
            return None
        try:
            return setup_of(
                factory,
                environment,
                actor,
                policy,
                action_repeat=action_repeat,
                num_threads=self._threads_each(episodes),
                any_processor=self.any_processor,
                vectorised=self.vectorised,
            )
        except ValueError:
            if self._is_asked_for:
                raise
            return None

    def open(self, episodes: int) -> contextlib.AbstractContextManager[Workers]:
        """The workers, for so many episodes; see `open_workers` for the errors."""
        workers = self.workers
        if not self._is_asked_for and self._processes(episodes) > 1:
            workers = self._processes(episodes)
        if workers is not None and self.executor is None and self.ray is None:
            workers = min(at_least_one("workers", workers), max(1, episodes))
        return open_workers(workers, executor=self.executor, ray=self.ray, on_state=self.on_state)

    @property
    def _is_asked_for(self) -> bool:
        return any(given is not None for given in (self.workers, self.executor, self.ray))

    def _processes(self, episodes: int) -> int:
        return self.workers or max(1, min(usable_cores(), episodes))

    def _threads_each(self, episodes: int) -> int:
        if self.num_threads is not None:
            return self.num_threads
        if self.executor is not None or self.ray is not None:
            return 1  # their workers' cores are not known here
        return max(1, usable_cores() // self._processes(episodes))


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
        waiting = queue_of(units)
        while waiting:
            unit = waiting.popleft()
            yield unit, function(unit.setup, unit.seeds, *unit.more)

    def close(self) -> None:
        """Does nothing."""
