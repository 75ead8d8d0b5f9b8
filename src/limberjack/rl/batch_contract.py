"""`Batch`: the interface of a batch of episodes, of either kind.

    batch: Batch = rl.batch_of(environment, num_envs=16)

`gym.VectorEnv`, `sb3.VecEnv` and `evaluate` know only this interface.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.rl.pixels import Pixels
from limberjack.rl.snapshot import Snapshot
from limberjack.utils.arrays import Quantity

__all__ = ["Batch"]

_Rows = Sequence[int] | np.ndarray | None  # sorted row numbers or a mask; None for all


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
        ids: _Rows = None,
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

    def snapshot(self, rows: _Rows = None) -> Snapshot:
        """Everything that the future of rows depends on."""
        ...

    def restore(self, snapshot: Snapshot, rows: _Rows = None) -> None:
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
        rows: _Rows = None,
    ) -> dm_env.TimeStep:
        """Continues episodes that `reset` has just begun in rows from given states."""
        ...

    def copy_row(self, source: int, target: int) -> None:
        """Makes row `target` a copy of row `source`."""
        ...

    def description(self) -> object:
        """The parts of the batch's `repr`, a `rl.represented.Description`."""
        ...

    def render(self, rows: _Rows = None, **kwargs: object) -> np.ndarray:
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
