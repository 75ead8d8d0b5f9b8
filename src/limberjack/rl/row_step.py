"""`RowStep`: the time steps of the rows of a batch, collected by the threads that step them.

    found = RowStep(num_envs, arrays_to_fill, last_observations)
    found.take(3, environment.step(action), environment)    # by the thread of row 3
    found.reward        # (num_envs,)

Each thread writes to its own rows only.

    errors = step_in_phases(environments, actions, found, share)

Python runs one thread at a time, and threads that take turns at short calls lose more than they
gain. Therefore the caller's thread runs the hooks of all rows that are plain. In between, threads
advance the simulations of all rows, which takes no lock. Each row makes the same calls in the same
order as a single environment. If actions are repeated, rows whose episode has ended wait for the
others.
"""

import collections
from collections.abc import Callable, Mapping, Sequence
from threading import get_ident

import dm_env
import numpy as np

from limberjack.rl.contract import PhysicsError
from limberjack.rl.control import Environment
from limberjack.rl.guards import OneUser
from limberjack.rl.observations import FLAT_OBSERVATION_KEY
from limberjack.rl.threads import RowErrors, interrupts

__all__ = ["RowStep", "Share", "as_mapping", "step_in_phases"]

_FIRST, _MID, _LAST = (int(kind) for kind in dm_env.StepType)


class RowStep:
    """See the module's docstring.

    Attributes:
      step_type, reward, discount: of each row, (num_envs,).
      observation: of all rows, (num_envs, ...) by name.
      diverged: mask of rows that diverged.
      timed_out: mask of rows whose episode was truncated.
      cut_off: mask of rows whose environment does not know that its episode has ended.
      steps: that each row has made.
      error: of a row that diverged.
    """

    def __init__(
        self, num_envs: int, observation: dict[str, np.ndarray], last: Mapping[str, np.ndarray]
    ) -> None:
        """Takes arrays to fill, (num_envs, ...) by name, and the observations of the last step."""
        self._last = last
        self.step_type = np.full(num_envs, _MID)
        self.reward = np.zeros(num_envs)
        self.discount = np.ones(num_envs)
        self.observation = observation
        # Name, array of all rows, and the shape and dtype that each row must have.
        self._forms = [(n, v, v.shape[1:], v.dtype) for n, v in self.observation.items()]
        self.diverged = np.zeros(num_envs, bool)
        self.timed_out = np.zeros(num_envs, bool)
        self.cut_off = np.zeros(num_envs, bool)
        self.steps = np.zeros(num_envs, int)
        self.error: PhysicsError | None = None

    def take(self, row: int, time_step: dm_env.TimeStep, plain: Environment | None) -> None:
        """Adds a row's time step.

        Args:
          row: the number of the row.
          time_step: of its environment.
          plain: the environment, if it is plain; another one's last step is a truncation if its
            discount is 1.

        Raises:
          ValueError, TypeError: it does not have the specs of the batch.
        """
        step_type = time_step.step_type  # by name: wrappers return tuples with more fields
        if step_type != _MID:
            self.step_type[row] = step_type
        if step_type != _FIRST:
            self.add_reward(row, time_step.reward)
            self.discount[row] = self._number("discount", time_step.discount)
        if step_type == _LAST:
            is_one = self.discount[row] == 1.0
            self.timed_out[row] = is_one if plain is None else Environment.timed_out.of(plain)
        given = time_step.observation
        if type(given) is not collections.OrderedDict:
            given = as_mapping(given)
        if len(given) != len(self._forms):
            raise self._other_names(given)
        for name, values, shape, dtype in self._forms:
            value = given.get(name)
            if type(value) is not np.ndarray:
                if name not in given:
                    raise self._other_names(given)
                value = np.asarray(value)
            if value.shape != shape or value.dtype != dtype:
                raise ValueError(
                    f"observation {name!r} has shape {value.shape} and dtype {value.dtype}; "
                    f"expected {shape} and {dtype}, those of its spec"
                )
            values[row] = value

    def add_reward(self, row: int, reward: object) -> None:
        """Adds to the reward of a row.

        Raises:
          TypeError: it is not a number.
        """
        self.reward[row] += self._number("reward", reward)

    def cut(self, row: int) -> None:
        """Ends a row's episode at the limit, which its environment does not know."""
        self.cut_off[row] = self.step_type[row] != _LAST
        self.timed_out[row] |= self.cut_off[row]
        self.step_type[row] = _LAST

    def diverge(self, row: int) -> None:
        """Ends a row's episode because its simulation diverged; it shows its last observation."""
        self.diverged[row] = True
        self.step_type[row] = _LAST
        self.discount[row] = 0.0
        self.steps[row] += 1
        for name, values in self.observation.items():
            values[row] = self._last[name][row]

    def end_diverged(self, row: int, plain: Environment, steps_before: int) -> None:
        """Ends a row whose plain environment diverged, with the rewards before that.

        Args:
          row: the number of the row.
          plain: its environment.
          steps_before: the environment's step count before the action.
        """
        self.steps[row] = plain._step_count - steps_before
        self.diverge(row)
        if plain._ours.action_repeat != 1:
            self.add_reward(row, plain._ours.reward_so_far)

    def _other_names(self, given: Mapping[str, object]) -> ValueError:
        return ValueError(
            f"the observation has {sorted(given)}; expected {sorted(self.observation)}, those of "
            "the batch"
        )

    @staticmethod
    def _number(what: str, value: object) -> float:
        if isinstance(value, float):
            return value
        number = np.asarray(value)
        if number.ndim or number.dtype.kind not in "fiub":
            raise TypeError(f"the {what} of a step is {value!r}; expected a number")
        return number.item()


def as_mapping(observation: object) -> Mapping[str, object]:
    """An observation by name; a single array has the name of a flat observation."""
    if isinstance(observation, Mapping):
        return observation
    return {FLAT_OBSERVATION_KEY: observation}


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
            self._enter(env._ours.use)
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
