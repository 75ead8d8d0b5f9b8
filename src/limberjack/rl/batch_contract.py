"""`Batch`: many episodes of a task in lockstep, of either kind.

    batch: Batch = rl.batch_of(environment, num_envs=16)

`gym.VectorEnv`, `sb3.VecEnv` and `evaluate` know only this interface.
"""

import abc
from collections.abc import Mapping, Sequence
from functools import partial

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.rl.contract import PhysicsError
from limberjack.rl.given_state import checked_states
from limberjack.rl.guards import (
    OneUser,
    as_rows,
    at_least_one,
    first_seed,
    raises_on_divergence,
    yes_or_no,
)
from limberjack.rl.pixels import Pixels, render_arguments, render_cameras
from limberjack.rl.represented import Description, represented
from limberjack.rl.snapshot import Snapshot
from limberjack.rl.streams import Stagger
from limberjack.utils.arrays import Quantity
from limberjack.utils.log import log

__all__ = ["Batch", "RowNumbers"]

RowNumbers = Sequence[int] | np.ndarray | None  # sorted, or a mask of (num_envs,); None for all


class Batch(abc.ABC):
    """Many episodes of a task in lockstep; row i equals the single environment of seed `seed + i`.

    `rl.batch.BatchEnvironment` is vectorised: the task's code runs once for all rows.
    `rl.rows.RowsEnvironment` consists of complete single environments. `rows` are sorted row
    numbers or a mask of (num_envs,); None for all.

    Attributes:
      num_envs: number of rows.
      first_row: number of the first row in messages; not 0 for the half of a batch.
      name: of the task, such as 'humanoid:walk'; its class's for a task outside the suite.
      registration: the suite's record of the domain; see `control.Environment`.
      why_rows: the reason why the task is not vectorised, with the change to make; None if it is.
      diverged: mask of rows that diverged in the last step, (num_envs,).
      flat_names: the observations that a flat array consists of; None for all.
    """

    num_envs: int
    first_row = 0
    name: str
    registration: object = None
    why_rows: str | None = None
    diverged: np.ndarray
    flat_names: tuple[str, ...] | None = None
    _action_spec: specs.BoundedArray
    _steps: np.ndarray  # of each row's episode, (num_envs,)

    def __init__(
        self,
        num_envs: int,
        seed: int | None,
        on_divergence: str,
        action_repeat: int,
        stagger: bool,
    ) -> None:
        """Creates a batch whose first `step` or `reset` begins an episode in every row."""
        self.num_envs = at_least_one("num_envs", num_envs)
        # Of each row's stream; None if it is not known.
        first = first_seed(seed, self.num_envs)
        self._seeds: list[int | None] = list(range(first, first + self.num_envs))
        self._raises = raises_on_divergence(on_divergence)
        self._action_repeat = at_least_one("action_repeat", action_repeat)
        self._stagger = Stagger(self.num_envs) if yes_or_no("stagger", stagger) else None
        self._begins = np.ones(self.num_envs, bool)  # mask of rows whose next step begins one
        self.diverged = np.zeros(self.num_envs, bool)
        self._use = OneUser("batch")

    @abc.abstractmethod
    def reset(
        self, ids: RowNumbers = None, seeds: Sequence[int | None] | None = None
    ) -> dm_env.TimeStep:
        """Begins an episode in all rows or in those given; returns the time step of all rows.

        Other rows keep their state and are reported as mid-episode, with reward 0.

        Args:
          ids: sorted row numbers or a mask of (num_envs,).
          seeds: for each row to reset, a seed whose first episode it begins, or None to continue
            the row's random stream.
        """

    @abc.abstractmethod
    def step(self, actions: npt.ArrayLike) -> dm_env.TimeStep:
        """Applies an action in every row; rows whose episode has ended begin one instead.

        Args:
          actions: numbers, (num_envs, ...); ignored in rows that begin an episode.

        Raises:
          ValueError, TypeError: the actions are not finite numbers with one row per environment,
            or the task rejects them; nothing was stepped.
          PhysicsError: a row diverged and `on_divergence` is 'raise'.
          Exception: any that the environment of a row raises, with a note of the row's number.
        """

    @abc.abstractmethod
    def snapshot(self, rows: RowNumbers = None) -> Snapshot:
        """Everything that the future of the batch, or of some rows, depends on.

        Raises:
          TypeError: an environment keeps something that cannot be copied.
        """

    @abc.abstractmethod
    def restore(self, snapshot: Snapshot, rows: RowNumbers = None) -> None:
        """Continues the batch, or some rows, from a snapshot, bit for bit.

        A row whose saved state is invalid diverges in the next step, as the saved row would.

        Args:
          snapshot: of a batch of either kind or of a single environment, with as many rows as
            `rows`.
          rows: sorted row numbers or a mask; None for all.

        Raises:
          ValueError, TypeError: it is not a snapshot, has another task, model, version or size, is
            damaged, or contains an episode at or beyond the step limit; nothing was restored.
        """

    @abc.abstractmethod
    def state_sizes(self) -> dict[str, int]:
        """Numbers in each field of a row's state, such as 'qpos', without empty fields.

        Raises:
          TypeError: a row is not a `control.Environment` on a simulation of MuJoCo.
        """

    @abc.abstractmethod
    def integration_states(self) -> np.ndarray:
        """MuJoCo's integration state of each row, (num_envs, nstate).

        Raises:
          TypeError: a row has no `control.Environment` inside.
        """

    @abc.abstractmethod
    def episode_fields(self) -> dict[str, np.ndarray]:
        """The model fields that were set for the rows' episodes, (num_envs, ...) by name.

        Raises:
          TypeError: as `integration_states`.
        """

    @property
    @abc.abstractmethod
    def step_limit(self) -> float:
        """Control steps per episode; infinite without a limit. It can be set."""

    @step_limit.setter
    @abc.abstractmethod
    def step_limit(self, limit: float) -> None: ...

    @property
    @abc.abstractmethod
    def timed_out(self) -> np.ndarray:
        """Mask of rows whose last step was truncated, (num_envs,)."""

    @property
    @abc.abstractmethod
    def success(self) -> np.ndarray | None:
        """Whether each row reached the goal in the last step, (num_envs,); None without a goal."""

    @property
    @abc.abstractmethod
    def reward_terms(self) -> dict[str, Quantity]:
        """The terms of the last step's reward, (num_envs,) each by name; may be empty."""

    @property
    @abc.abstractmethod
    def randomization(self) -> dict[str, np.ndarray]:
        """The values drawn for the rows' episodes, (num_envs, ...) by field."""

    @property
    @abc.abstractmethod
    def pixels(self) -> Pixels | None:
        """Options of the pixel observations; None without them."""

    @abc.abstractmethod
    def draw_every(self, steps: int) -> None:
        """Takes a picture of a row at each `steps`-th step; see `control.Environment`."""

    @abc.abstractmethod
    def control_timestep(self) -> float:
        """Time between two control steps, seconds."""

    @abc.abstractmethod
    def single_action_spec(self) -> specs.BoundedArray:
        """The spec of one row's action."""

    @abc.abstractmethod
    def observation_spec(self) -> Mapping[str, specs.Array]:
        """The specs of the observations of all rows, (num_envs, ...) each."""

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
            late = named[self._begins[numbers] | (self._steps[numbers] > 0)].tolist()
            if late:
                raise RuntimeError(
                    f"no episode has just begun in rows {late}: call reset(rows) before "
                    "set_states()"
                )
            self._begins[numbers] = True  # until it is complete
            time_step = self._set_checked(checked, numbers)
            self._begins[numbers] = False
        return time_step

    def _set_checked(self, states: Mapping[str, np.ndarray], rows: np.ndarray) -> dm_env.TimeStep:
        """Sets valid states of rows that have just begun; returns the time step of all rows."""
        raise TypeError(f"the rows of {self.name} have no common state")

    def rows_with(self, term: str) -> np.ndarray | None:
        """Mask of the rows whose task has a term of the reward, (num_envs,); None for all.

        Args:
          term: a name of `reward_terms`, or 'success'.
        """
        del term  # the rows of one task have the same ones
        return None

    def restart(self) -> None:
        """Make every row begin an episode with the next step, in the middle of one too."""
        self._begins[:] = True

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

    def description(self) -> Description:
        """The parts of the batch's `repr`."""
        steps = self._steps.tolist()
        begun = not self._begins.all() or any(steps)
        return Description(
            self.name, self.num_envs, self._seeds, steps if begun else [], self.step_limit
        )

    def __repr__(self) -> str:
        return represented(self, self.description())

    def _numbers(self, ids: RowNumbers) -> np.ndarray:
        """Sorted row numbers from row numbers, a mask, or None for all."""
        return np.arange(self.num_envs) if ids is None else as_rows(ids, self.num_envs)

    def _report_divergence(self, cause: PhysicsError | None = None) -> None:
        """Raises PhysicsError for the rows that have just diverged, or logs them."""
        rows = (np.flatnonzero(self.diverged) + self.first_row).tolist()
        if self._raises:
            raise PhysicsError(f"the simulations of rows {rows} diverged") from cause
        log.warning("the simulations of rows %s diverged; their episodes end here", rows)
