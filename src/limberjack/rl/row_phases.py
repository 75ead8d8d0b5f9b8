"""`step_in_phases`: a step of plain rows, with their physics in threads and the rest in order.

    errors = step_in_phases(environments, actions, found, threads)

Python runs one thread at a time, and threads that take turns lose more than they gain. Therefore
the caller's thread runs the hooks of all rows, before and after the threads advance the simulations
of all rows, which takes no lock. Each row makes the same calls in the same order as by itself.

If an action is repeated, rows whose episode has ended wait for the others.
"""

from collections.abc import Callable, Mapping, Sequence
from threading import get_ident

import numpy as np

from limberjack.rl.contract import PhysicsError
from limberjack.rl.control import Environment
from limberjack.rl.guards import OneUser
from limberjack.rl.row_step import RowStep
from limberjack.rl.row_threads import RowThreads

__all__ = ["step_in_phases"]

_Errors = list[tuple[int, BaseException]]


def step_in_phases(
    environments: Mapping[int, Environment],
    actions: np.ndarray,
    found: RowStep,
    threads: RowThreads,
) -> _Errors:
    """Steps rows in mid-episode, and returns their errors, by row.

    Every row is tried, except after an interrupt.

    Args:
      environments: by row; plain ones that can be stepped in parts.
      actions: finite numbers, (num_envs, ...).
      found: takes the time steps.
      threads: that advance the simulations.
    """
    phases = _Phases(environments, actions, found, threads)
    try:
        phases.step()
    finally:
        for use in phases.entered:
            use.leave()
    return phases.errors


class _Phases:
    """The step of `step_in_phases`, of which rows drop out as they end or fail."""

    def __init__(
        self,
        environments: Mapping[int, Environment],
        actions: np.ndarray,
        found: RowStep,
        threads: RowThreads,
    ) -> None:
        self.errors: _Errors = []
        self.entered: list[OneUser] = []
        self._environments = environments
        self._actions = actions
        self._found = found
        self._threads = threads
        self._number = 0  # of the control step of this action
        # The functions that advance a row's simulation and check it.
        self._physics: dict[int, tuple[Callable[[], None], Callable[[], None]]] = {}
        self._steps_before = {row: env._step_count for row, env in environments.items()}

    def step(self) -> None:
        rows = self._each(self._enter, list(self._environments))
        while rows:
            rows = self._each(self._begin, rows)
            failed = dict(self._threads.share(self._advance, rows))
            if failed:
                self.errors += failed.items()
                if not all(isinstance(error, Exception) for error in failed.values()):
                    return
                rows = [row for row in rows if row not in failed]
            rows = self._each(self._end, rows)
            self._number += 1

    def _each(self, job: Callable[[int], bool], rows: Sequence[int]) -> list[int]:
        """Calls `job(row)` in this thread; returns the rows that go on, none after an interrupt."""
        going_on: list[int] = []
        for row in rows:
            try:
                if job(row):
                    going_on.append(row)
            except PhysicsError:
                self._diverge(row)
            except BaseException as error:  # of any class: it is the user's code
                self.errors.append((row, error))
                if not isinstance(error, Exception):  # an interrupt, or the user's exit
                    return []
        return going_on

    def _enter(self, row: int) -> bool:
        use, thread = self._environments[row]._use, get_ident()
        self.entered.append(use)
        if use.enter(thread) != thread:
            self.entered.pop()
            use.refuse(thread)
            self.entered.append(use)
        return True

    def _begin(self, row: int) -> bool:
        env = self._environments[row]
        env._begin_control_step(self._actions[row], self._number)
        self._physics[row] = env.physics.step_in_parts(env._n_sub_steps)
        return True

    def _advance(self, row: int) -> None:
        self._physics[row][0]()

    def _end(self, row: int) -> bool:
        env = self._environments[row]
        self._physics[row][1]()
        time_step = env._end_control_step(self._number)
        if time_step is None:
            return True
        self._found.take(row, time_step, env)
        self._found.steps[row] = env._step_count - self._steps_before[row]
        return False

    def _diverge(self, row: int) -> None:
        self._found.end_diverged(row, self._environments[row], self._steps_before[row])
