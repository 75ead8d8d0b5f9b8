"""`Counter`: counts the steps of each row's episode and determines its step type.

    counter = Counter(num_envs=256, step_limit=1000)
    time_step, last = counter.count(begins, diverged, reward, termination, observation)

A row that begins an episode has reward 0 and discount 1; a row that diverges ends with reward 0 and
discount 0. If the time limit and the task end an episode in the same step, the time limit wins.
"""

from collections.abc import Mapping, MutableMapping

import dm_env
import numpy as np

from limberjack.utils import arrays
from limberjack.utils.arrays import Quantity

__all__ = ["Counter", "Repeated"]

_FIRST, _MID, _LAST = (int(kind) for kind in dm_env.StepType)


class Counter:
    """See the module's docstring.

    Attributes:
      steps: steps since each row's episode began, (num_envs,).
      step_limit: steps per episode.
      limits: of each row's present episode, steps, (num_envs,); None if all have `step_limit`.
    """

    def __init__(self, num_envs: int, step_limit: float, task: str = "task") -> None:
        """Takes the number of rows, the limit, and the task's name for messages."""
        self._task = task
        self.steps = np.zeros(num_envs, int)
        self.step_limit = step_limit
        self.limits: np.ndarray | None = None
        self._are_single: dict[str, bool] = {}  # whether a hook returned one number at first
        self._all_mid, self._all_one = np.full(num_envs, _MID), np.ones(num_envs)

    @property
    def at_limit(self) -> np.ndarray:
        """Mask of rows that have reached the step limit, (num_envs,)."""
        return self.steps >= (self.step_limit if self.limits is None else self.limits)

    @property
    def reach_limit(self) -> np.ndarray:
        """Mask of rows whose present step, not counted yet, reaches the step limit."""
        return self.steps + 1 >= (self.step_limit if self.limits is None else self.limits)

    def shown(self, observation: Mapping[str, np.ndarray]) -> dm_env.TimeStep:
        """The time step of a reset: FIRST for rows that begin, MID for others; rewards are 0."""
        step_type = np.where(self.steps == 0, _FIRST, _MID)
        return dm_env.TimeStep(
            step_type, np.zeros(len(self.steps)), self._all_one.copy(), observation
        )

    def count(
        self,
        begins: np.ndarray | None,
        diverged: np.ndarray,
        reward: Quantity,
        termination: Quantity | None,
        observation: Mapping[str, np.ndarray],
    ) -> tuple[dm_env.TimeStep, np.ndarray]:
        """Counts a step; returns the time step and a mask of rows that end, (num_envs,).

        Args:
          begins: mask of rows that began an episode with this step; None for none.
          diverged: mask of rows that diverged.
          reward: the task's reward, (num_envs,) or one number for all rows.
          termination: the task's termination; see `control.Task.get_termination`.
          observation: the observation for the time step.
        """
        reward = self._numbers("get_reward", reward)
        self.steps += 1
        discount, step_type = self._all_one.copy(), self._all_mid.copy()
        last = self.at_limit
        if begins is not None:
            self.steps[begins] = 0
            last &= ~begins
            reward[begins] = 0.0
            step_type[begins] = _FIRST
        if termination is None:
            self._are_single.setdefault("get_termination", False)
        else:
            termination = self._numbers("get_termination", termination)
            ends = ~np.isnan(termination) & ~last
            if begins is not None:
                ends &= ~begins
            discount[ends] = termination[ends]
            last |= ends
        if arrays.any_of(diverged):
            last |= diverged
            reward[diverged] = 0.0
            discount[diverged] = 0.0
        if arrays.any_of(last):
            step_type[last] = _LAST
        return dm_env.TimeStep(step_type, reward, discount, observation), last

    def _numbers(self, hook: str, given: object) -> np.ndarray:
        """A copy of what a hook returned as one number for each row.

        Raises:
          TypeError: it is not made of numbers.
          ValueError: it has another shape than () or (num_envs,), or is one number for all rows
            where it was not before, as from `if (heights < 1).any(): return 0.0`.
        """
        try:
            if given is None:  # of which NumPy makes NaN
                raise TypeError("None is no number")
            numbers = np.array(given, float)  # pyright: ignore[reportArgumentType, reportCallIssue]
        except (TypeError, ValueError) as error:
            raise TypeError(
                f"{hook} of task {self._task} returned {given!r}; expected a number for each of "
                f"{len(self.steps)} rows"
            ) from error
        if numbers.shape == self.steps.shape:
            self._are_single.setdefault(hook, False)
            return numbers
        if numbers.shape != ():
            raise ValueError(
                f"{hook} of task {self._task} returned an array of shape {numbers.shape}; expected "
                f"{self.steps.shape}, one number for each row"
            )
        if not self._are_single.setdefault(hook, True) and len(self.steps) > 1:
            raise ValueError(
                f"{hook} of task {self._task} returned {given!r} for all {len(self.steps)} rows, "
                "which it did not before: decide for each row, as with np.where, or take "
                "vectorised=False"
            )
        return np.full(self.steps.shape, numbers)


class Repeated:
    """The time step of a batch that makes several control steps with one action.

    Attributes:
      terms: the reward terms of each row, summed, (num_envs,) by name.
      last_terms: the reward terms of each row's last control step.
      observation: of each row's last control step.
      step_type: as above.
    """

    def __init__(self, num_envs: int) -> None:
        self.terms: dict[str, Quantity] = {}
        self.last_terms: dict[str, np.ndarray] = {}
        self.observation: MutableMapping[str, np.ndarray] = {}
        self.step_type = np.full(num_envs, _LAST)
        self._reward, self._discount = np.zeros(num_envs), np.ones(num_envs)

    def add(
        self,
        time_step: dm_env.TimeStep,
        terms: Mapping[str, Quantity],
        shown: np.ndarray,
        stepped: np.ndarray,
        diverged: np.ndarray,
    ) -> None:
        """Adds a control step.

        Args:
          time_step: of all rows.
          terms: the reward terms of all rows.
          shown: mask of rows whose observation and step type count, (num_envs,).
          stepped: mask of the rows among them whose reward and discount count too.
          diverged: mask of the rows whose reward terms are meaningless.
        """
        for name, values in time_step.observation.items():
            if name in self.observation:
                self.observation[name][shown] = values[shown]
        if not self.observation:
            self.observation = time_step.observation
        self.step_type[shown] = time_step.step_type[shown]
        self._reward[stepped] += time_step.reward[stepped]
        self._discount[stepped] = time_step.discount[stepped]
        valid = stepped & ~diverged
        for name, values in terms.items():
            of_rows = np.broadcast_to(values, stepped.shape)
            known = self.terms.setdefault(name, np.zeros(stepped.shape))
            last = self.last_terms.setdefault(name, np.zeros(stepped.shape))
            self.terms[name] = np.where(valid, known + of_rows, known)
            last[valid] = of_rows[valid]

    def time_step(self) -> dm_env.TimeStep:
        """The time step of all rows."""
        return dm_env.TimeStep(self.step_type, self._reward, self._discount, self.observation)
