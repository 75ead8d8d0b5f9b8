"""`Transitions`: resets and steps of a `Batch` in Gymnasium's terms.

There are three autoreset modes, which differ in the step after a row's last: see docs/batches.md.
"""

from collections.abc import Mapping, Sequence

import dm_env
import numpy as np
import numpy.typing as npt
from gymnasium import error
from gymnasium.vector import AutoresetMode

from limberjack.gym.observations import Observation, Observations
from limberjack.gym.states import States
from limberjack.rl.batch_contract import Batch
from limberjack.rl.guards import check_actions
from limberjack.utils.arrays import any_of

__all__ = ["Step", "Transitions"]

_Info = dict[str, object]

# Observation, reward, terminated, truncated, info.
Step = tuple[Observation, np.ndarray, np.ndarray, np.ndarray, _Info]

_FIRST, _LAST = int(dm_env.StepType.FIRST), int(dm_env.StepType.LAST)


class Transitions:
    """Resets and steps of a batch."""

    def __init__(
        self, batch: Batch, mode: AutoresetMode, observations: Observations, copy: bool
    ) -> None:
        """Take over a batch.

        Args:
          batch: it must not be used elsewhere at the same time.
          mode: the time at which a row whose episode has ended begins the next one.
          observations: the form of the observations.
          copy: return observations in new arrays each time; otherwise in one array if that is
            faster.
        """
        self.batch = batch
        self._mode = mode
        self._observations = observations
        self._copies = copy
        self._buffer = None if copy else observations.buffer(batch.num_envs)

    def reset(
        self, seeds: Sequence[int | None], begun: np.ndarray, states: States
    ) -> tuple[Observation, _Info]:
        """Begin an episode in the rows of a mask; return observation and info.

        Args:
          seeds: of each row's random stream, which continues where the seed is None.
          begun: the mask, (num_envs,).
          states: states to continue from, checked and of these rows only.
        """
        batch = self.batch
        of_rows = [seeds[row] for row in np.flatnonzero(begun).tolist()]
        time_step = batch.reset(begun, of_rows)
        for rows, state in states:
            time_step = batch.set_states(state, rows)
        return self._in_form(time_step.observation), self._drawn(begun)

    def step(self, actions: npt.ArrayLike) -> Step:
        """Step every row, after `check_begun` or `checked`.

        Raises:
          ValueError, TypeError, PhysicsError: see `Batch.step`.
        """
        batch = self.batch
        time_step = batch.step(actions)
        diverged = batch.diverged.copy()  # before rows that have ended begin again
        observation = self._in_form(time_step.observation)
        step_type = time_step.step_type
        last = step_type == _LAST
        truncated = np.zeros(batch.num_envs, bool)
        any_last = any_of(last)
        if any_last:
            truncated = batch.timed_out
        if any_last and self._mode is AutoresetMode.SAME_STEP:
            observation, info = self._begin_next(last, observation)
        else:
            first = step_type == _FIRST
            info = self._terms(~first) | self._drawn(first)
        info |= {"diverged": diverged, "_diverged": np.ones(batch.num_envs, bool)}
        return observation, time_step.reward, last & ~truncated, truncated, info

    def checked(self, actions: npt.ArrayLike) -> np.ndarray:
        """A copy of the actions; raises the errors that `step` would raise for them."""
        self.check_begun()
        batch = self.batch
        given = check_actions(actions, batch.num_envs, batch.begins, batch.first_row)
        shape = batch.action_spec().shape
        if given.shape != shape:
            raise ValueError(
                f"actions have shape {given.shape}; expected {shape}, that of the half's rows; "
                "nothing was stepped"
            )
        return np.array(given)

    def check_begun(self) -> None:
        """Raise ResetNeeded if rows wait for a reset that the mode leaves to the user."""
        if self._mode is AutoresetMode.NEXT_STEP:
            return
        waiting = np.flatnonzero(self.batch.begins)
        if waiting.size:
            rows = (waiting + self.batch.first_row).tolist()
            raise error.ResetNeeded(
                f"no episode is running in rows {rows}: reset them with "
                "options={'reset_mask': mask}; nothing was stepped"
            )

    def _begin_next(self, last: np.ndarray, observation: Observation) -> tuple[Observation, _Info]:
        """Begin the next episode of rows; the info has the last observation of the old one."""
        ended = np.flatnonzero(last)
        final = np.full(len(last), None, object)
        for row, one in zip(
            ended, self._observations.copies_of_rows(observation, ended), strict=True
        ):
            final[row] = one
        info = self._terms(~last)
        info |= {"final_obs": final, "_final_obs": last}
        info |= {"final_info": self._terms(last), "_final_info": last}
        observation = self._in_form(self.batch.reset(ended).observation)
        return observation, info | self._drawn(last)

    def _drawn(self, begun: np.ndarray) -> _Info:
        """The model's fields that were drawn for the episodes that rows have begun."""
        drawn = self.batch.randomization
        if not drawn or not any_of(begun):
            return {}
        # As in Gymnasium: the mask of the rows that each is valid for stands beside it.
        values = {name: values.copy() for name, values in drawn.items()}
        # Of several tasks, some may not have it.
        masks = {
            f"_{name}": begun & [value is not None for value in of_rows]
            for name, of_rows in values.items()
        }
        return {"randomization": values | masks, "_randomization": begun.copy()}

    def _terms(self, rows: np.ndarray) -> _Info:
        """The terms of the last step's reward, and whether the goal is reached, in some rows.

        Args:
          rows: mask of the rows that these are valid for; the others have zeros.
        """
        batch = self.batch
        terms = batch.reward_terms
        if not terms:
            return {}
        rows = rows & ~batch.diverged
        all_rows = bool(rows.all())
        shown = {
            # Each step computes new arrays, which need no copy.
            name: values if all_rows and _is_own(values) else np.where(rows, values, 0.0)
            for name, values in terms.items()
        }
        masks = {name: self._rows_with(name, rows) for name in shown}
        of_terms = {**shown, **{f"_{name}": mask for name, mask in masks.items()}}
        info: _Info = {"reward_terms": of_terms, "_reward_terms": rows}
        success = batch.success
        if success is not None:
            info |= {"success": success & rows, "_success": self._rows_with("success", rows)}
        return info

    def _rows_with(self, term: str, rows: np.ndarray) -> np.ndarray:
        """Those of some rows whose task has a term, as a new mask."""
        having = self.batch.rows_with(term)
        return rows.copy() if having is None else rows & having

    def _in_form(self, observation: Mapping[str, np.ndarray]) -> Observation:
        if self._copies:
            buffer = self._observations.buffer(self.batch.num_envs)
            return self._observations.of_batch(observation, buffer)
        return self._observations.of_batch(observation, self._buffer)


def _is_own(values: object) -> bool:
    """Whether it is an array of one number for each row, and not a view of another array."""
    return isinstance(values, np.ndarray) and values.ndim == 1 and values.flags.owndata
