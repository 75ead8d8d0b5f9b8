"""`Batch`: the interface of a batch of episodes, of either kind; `Lockstep`: their common parts.

    batch: Batch = rl.batch_of(environment, num_envs=16)

`gym.VectorEnv`, `sb3.VecEnv` and `evaluate` know only the interface.
"""

import abc
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Protocol

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.rl.contract import PhysicsError
from limberjack.rl.given_state import checked_states
from limberjack.rl.guards import OneUser, as_rows
from limberjack.rl.pixels import Pixels, render_arguments, render_cameras
from limberjack.rl.snapshot import Snapshot
from limberjack.utils.arrays import Quantity
from limberjack.utils.log import log

__all__ = ["Batch", "Lockstep", "RowNumbers"]

RowNumbers = Sequence[int] | np.ndarray | None  # sorted, or a mask of (num_envs,); None for all


class Batch(Protocol):
    """Many episodes of a task in lockstep, of either kind.

    `rl.batch.BatchEnvironment` is vectorised: the task's code runs once for all rows.
    `rl.rows.RowsEnvironment` consists of complete single environments. Their users know only this
    interface. `rows` are sorted row numbers or a mask of (num_envs,); None for all.
    """

    num_envs: int
    first_row: int  # number of the first row in messages; not 0 for the half of a batch
    registration: object  # the suite's record of the domain; see `control.Environment`

    @property
    def step_limit(self) -> float:
        """Steps per episode; infinite without a limit. It can be set."""
        ...

    @step_limit.setter
    def step_limit(self, limit: float) -> None: ...

    @property
    def action_repeat(self) -> int:
        """Control steps per action; returns, lengths and limits count control steps."""
        ...

    @property
    def diverged(self) -> np.ndarray:
        """Mask of rows that diverged in the last step, (num_envs,)."""
        ...

    @property
    def reward_terms(self) -> dict[str, Quantity]:
        """The terms of the last step's reward, (num_envs,) each, by name."""
        ...

    @property
    def randomization(self) -> dict[str, np.ndarray]:
        """The values drawn for the rows' episodes, (num_envs, ...) by field."""
        ...

    @property
    def why_rows(self) -> str | None:
        """The reason why the task is not vectorised, with the change to make; None if it is."""
        ...

    @property
    def name(self) -> str:
        """The task's name."""
        ...

    @property
    def pixels(self) -> Pixels | None:
        """Options of the pixel observations; None without them."""
        ...

    def draw_every(self, steps: int) -> None:
        """Takes a picture of a row at each `steps`-th step; see `control.Environment`."""
        ...

    @property
    def begins(self) -> np.ndarray:
        """Mask of rows whose next step begins an episode, (num_envs,)."""
        ...

    @property
    def timed_out(self) -> np.ndarray:
        """Mask of rows whose last step was truncated, (num_envs,)."""
        ...

    @property
    def success(self) -> np.ndarray | None:
        """Whether each row reached the goal in the last step, (num_envs,); None without a goal."""
        ...

    def reset(
        self,
        ids: RowNumbers = None,
        seeds: Sequence[int | None] | None = None,
    ) -> dm_env.TimeStep:
        """Begins an episode in rows; returns the time step of all rows."""
        ...

    def restart(self) -> None:
        """Makes every row begin an episode with the next step."""
        ...

    def step(self, actions: npt.ArrayLike) -> dm_env.TimeStep:
        """Applies an action in every row; rows whose episode has ended begin one instead."""
        ...

    def snapshot(self, rows: RowNumbers = None) -> Snapshot:
        """Everything that the future of rows depends on."""
        ...

    def restore(self, snapshot: Snapshot, rows: RowNumbers = None) -> None:
        """Continues rows from a snapshot."""
        ...

    def state_sizes(self) -> dict[str, int]:
        """Numbers in each field of a row's state, such as 'qpos', without empty fields."""
        ...

    def integration_states(self) -> np.ndarray:
        """MuJoCo's integration state of each row, (num_envs, nstate)."""
        ...

    def episode_fields(self) -> dict[str, np.ndarray]:
        """The model fields that were set for the rows' episodes, (num_envs, ...) by name."""
        ...

    def set_states(
        self,
        states: Mapping[str, npt.ArrayLike] | Snapshot,
        rows: RowNumbers = None,
    ) -> dm_env.TimeStep:
        """Continues episodes that `reset` has just begun in rows from given states."""
        ...

    def copy_row(self, source: int, target: int) -> None:
        """Makes row `target` a copy of row `source`."""
        ...

    def description(self) -> object:
        """The parts of the batch's `repr`, a `rl.represented.Description`."""
        ...

    def render(self, rows: RowNumbers = None, **kwargs: object) -> np.ndarray:
        """Pictures of rows, (n, height, width, 3) uint8."""
        ...

    def control_timestep(self) -> float:
        """Time between two actions, seconds."""
        ...

    def action_spec(self) -> specs.BoundedArray:
        """The spec of the actions of all rows, (num_envs, ...)."""
        ...

    def single_action_spec(self) -> specs.BoundedArray:
        """The spec of one row's action."""
        ...

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """The specs of the observations of all rows, (num_envs, ...) each."""
        ...

    def reward_spec(self) -> specs.Array:
        """The spec of the rewards, (num_envs,)."""
        ...

    def discount_spec(self) -> specs.BoundedArray:
        """The spec of the discounts, (num_envs,)."""
        ...

    def close(self) -> None:
        """Frees the rows; may be called repeatedly."""
        ...


class Lockstep(abc.ABC):
    """The parts of a batch that do not depend on its kind."""

    num_envs: int
    first_row = 0  # number of the first row in messages; not 0 for the half of a batch
    diverged: np.ndarray
    _begins: np.ndarray  # mask of rows whose next step begins an episode
    _raises: bool  # whether divergence is an error
    _use: OneUser
    _action_repeat: int
    _action_spec: specs.BoundedArray

    @abc.abstractmethod
    def reset(
        self, ids: RowNumbers = None, seeds: Sequence[int | None] | None = None
    ) -> dm_env.TimeStep:
        """See `Batch`."""

    @abc.abstractmethod
    def snapshot(self, rows: RowNumbers = None) -> Snapshot:
        """See `Batch`."""

    @abc.abstractmethod
    def restore(self, snapshot: Snapshot, rows: RowNumbers = None) -> None:
        """See `Batch`."""

    @abc.abstractmethod
    def state_sizes(self) -> dict[str, int]:
        """See `Batch`."""

    @abc.abstractmethod
    def _step_counts(self) -> np.ndarray:
        """Steps of each row's episode, (num_envs,)."""

    @abc.abstractmethod
    def _set_checked(self, states: Mapping[str, np.ndarray], rows: np.ndarray) -> dm_env.TimeStep:
        """Sets valid states of rows that have just begun; returns the time step of all rows."""

    @abc.abstractmethod
    def _draw(self, rows: np.ndarray, **kwargs: object) -> np.ndarray:
        """Pictures of rows by one camera."""

    @abc.abstractmethod
    def _free(self) -> None:
        """Frees the rows."""

    def set_states(
        self, states: Mapping[str, npt.ArrayLike] | Snapshot, rows: RowNumbers = None
    ) -> dm_env.TimeStep:
        """Continues the episodes that `reset` has just begun in rows from given states.

        Args:
          states: some of 'qpos' (n, nq), 'qvel' (n, nv) and 'act' (n, na), for n rows; or a
            snapshot of n environments. See `control.Environment.set_state`.
          rows: sorted row numbers or a mask; None for all.

        Returns:
          The time step of all rows, as `reset` does.

        Raises:
          ValueError, TypeError: the states are invalid, see `limberjack.rl.given_state`, or the
            snapshot does not fit, see `restore`; nothing was set.
          RuntimeError: a mapping is given, and `reset` was not the last call for a row.
        """
        numbers = self._numbers(rows)
        if isinstance(states, Snapshot):
            self.restore(states, numbers)
            return self.reset([])
        named = numbers + self.first_row
        checked = checked_states(states, self.state_sizes(), len(numbers), named=named)
        with self._use:
            late = named[self._begins[numbers] | (self._step_counts()[numbers] > 0)].tolist()
            if late:
                raise RuntimeError(
                    f"no episode has just begun in rows {late}: call reset(rows) before "
                    "set_states()"
                )
            self._begins[numbers] = True  # until it is complete
            time_step = self._set_checked(checked, numbers)
            self._begins[numbers] = False
        return time_step

    def copy_row(self, source: int, target: int) -> None:
        """Makes row `target` a copy of row `source`, including its random stream."""
        self.restore(self.snapshot([source]), [target])

    def close(self) -> None:
        """Frees the rows; the batch then raises if it is used. May be called repeatedly."""
        if self._use.what_is_wrong is None:
            with self._use:
                self._free()
            self._use.what_is_wrong = "this batch is closed: create a new one"

    def render(self, rows: RowNumbers = None, **kwargs: object) -> np.ndarray:
        """Pictures of all rows or some, (n, height, width, 3) uint8.

        Args:
          rows: sorted row numbers or a mask of (num_envs,); None for all.
          kwargs: arguments of `Physics.render`: height, width, camera_id (or camera), depth, ...
            The pictures of a list of cameras are joined side by side.

        Raises:
          ValueError, TypeError, RenderingError: see `Physics.render`; or there is no such row.
        """
        with self._use:
            draw = partial(self._draw, self._numbers(rows))
            return render_cameras(draw, render_arguments(kwargs), axis=2)

    @property
    def begins(self) -> np.ndarray:
        """Mask of rows whose next step begins an episode, (num_envs,)."""
        return self._begins.copy()

    @property
    def action_repeat(self) -> int:
        """Control steps per action; calls of `step` of environments that are not plain."""
        return self._action_repeat

    def action_spec(self) -> specs.BoundedArray:
        """The spec of the actions of all rows, (num_envs, ...)."""
        return self._action_spec

    def reward_spec(self) -> specs.Array:
        """The spec of the rewards, (num_envs,)."""
        return specs.Array((self.num_envs,), float, name="reward")

    def discount_spec(self) -> specs.BoundedArray:
        """The spec of the discounts, (num_envs,)."""
        return specs.BoundedArray((self.num_envs,), float, 0.0, 1.0, name="discount")

    def _numbers(self, ids: RowNumbers) -> np.ndarray:
        """Sorted row numbers from row numbers, a mask, or None for all."""
        return np.arange(self.num_envs) if ids is None else as_rows(ids, self.num_envs)

    def _report_divergence(self) -> None:
        """Raises PhysicsError for the rows that have just diverged, or logs them."""
        rows = (np.flatnonzero(self.diverged) + self.first_row).tolist()
        if self._raises:
            raise PhysicsError(f"the simulations of rows {rows} diverged")
        log.warning("the simulations of rows %s diverged; their episodes end here", rows)
