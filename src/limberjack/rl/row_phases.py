"""`step_in_phases`: a step of plain rows, with their hooks in order and their physics in threads.

    errors = step_in_phases(environments, actions, found, share)

Python runs one thread at a time, and threads that take turns at short calls lose more than they
gain. Therefore the caller's thread runs the hooks of all rows. In between, threads advance the
simulations of all rows, which takes no lock. Each row makes the same calls in the same order as a
single environment.

If actions are repeated, rows whose episode has ended wait for the others.
"""

from collections.abc import Callable, Mapping, Sequence
from threading import get_ident

import numpy as np

from limberjack.rl.contract import PhysicsError
from limberjack.rl.control import Environment
from limberjack.rl.guards import OneUser
from limberjack.rl.row_step import RowStep
from limberjack.rl.row_threads import RowErrors, interrupts

__all__ = ["Share", "step_in_phases"]

# Calls a function for each of some rows, in several threads; returns the errors.
Share = Callable[[Callable[[int], None], Sequence[int]], RowErrors]


def step_in_phases(
    environments: Mapping[int, Environment], actions: np.ndarray, found: RowStep, share: Share
) -> RowErrors:
    """Steps rows in mid-episode, and returns their errors, by row.

    A row that diverges ends. Every row is tried, unless an interrupt is among the errors.

    Args:
      environments: by row; plain ones that can be stepped in parts.
      actions: finite numbers of all rows, (num_envs, ...).
      found: takes the time steps.
      share: calls a function for each of some rows, in several threads; returns the errors.
    """
    phases = _Phases(environments, actions, found)
    try:
        phases.step(share)
    finally:
        for use in phases.entered:
            use.leave()
    return phases.errors


class _Phases:
    """A step of several rows.

    Attributes:
      errors: of the rows until now.
      entered: the contexts of the environments, which this thread is to leave.
    """

    def __init__(
        self, environments: Mapping[int, Environment], actions: np.ndarray, found: RowStep
    ) -> None:
        self.errors: RowErrors = []
        self.entered: list[OneUser] = []
        self._environments = environments
        self._actions = actions
        self._found = found
        self._thread = get_ident()
        self._number = 0  # of the control step with these actions
        self._steps_before = {row: env._step_count for row, env in environments.items()}
        # The functions that advance the simulation of a row and check it.
        self._physics: dict[int, tuple[Callable[[], None], Callable[[], None]]] = {}

    def step(self, share: Share) -> None:
        rows = list(self._environments)
        while rows:
            rows = self._each(self._begin, rows)
            failed = share(self._advance, rows)
            if failed:
                self.errors += failed
                if interrupts(failed):
                    return
                lost = dict(failed)
                rows = [row for row in rows if row not in lost]
            rows = self._each(self._end, rows)
            self._number += 1

    def _each(self, job: Callable[[int], bool], rows: Sequence[int]) -> list[int]:
        """Calls `job(row)` in this thread; returns the rows that go on, none after an interrupt."""
        going_on: list[int] = []
        for row in rows:
            try:
                if job(row):
                    going_on.append(row)
            except PhysicsError as error:
                self._found.error = error
                self._found.end_diverged(row, self._environments[row], self._steps_before[row])
            except BaseException as error:  # of any class: it is the user's code
                self.errors.append((row, error))
                if not isinstance(error, Exception):  # an interrupt, or the user's exit
                    return []
        return going_on

    def _begin(self, row: int) -> bool:
        env = self._environments[row]
        if self._number == 0:
            self._enter(env._use)
        env._begin_control_step(self._actions[row], self._number)
        self._physics[row] = env.physics.step_in_parts(env._n_sub_steps)
        return True

    def _enter(self, use: OneUser) -> None:
        self.entered.append(use)  # first, for an interrupt
        if use.enter(self._thread) == self._thread:
            return
        self.entered.pop()
        use.refuse(self._thread)
        self.entered.append(use)

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
