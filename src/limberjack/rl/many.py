"""`ManyTasks`: batches of several tasks as one batch.

    batch = ManyTasks([suite.load_batch("cheetah", "run", 8, 1), suite.load_batch("lqr", ...)])
    batch = suite.load_batch(["cheetah:run", "walker:walk"], rows=8)    # makes them as well
    batch.tasks[1].rows                                                 # slice(8, 16)

The rows are those of the first batch, then those of the second, and so on; each equals, bit for
bit, the same row of its task's batch. Observations are one array, (num_envs, D), as wide as the
widest task needs: a row has the numbers of its task's flat observation, then zeros. Actions are one
array, (num_envs, A): a task takes the first of its row and ignores the rest, whatever it is. Masks
name the numbers that belong to a row's task. They stand beside the observations of a time step:

    time_step.observation["observations"]       # (num_envs, D)
    time_step.observation["observation_mask"]   # (num_envs, D), as `batch.observation_mask`
    time_step.observation["action_mask"]        # (num_envs, A), as `batch.action_mask`
    time_step.observation["task_id"]            # (num_envs,), as `batch.task_ids`

A few threads step the batches, those first that took longest so far. A thread that has finished one
takes the next, so that no task waits for another before the end of the step. If environments draw
from a stream that all share, the batches are stepped on one thread, in order.

It is one idea, and long: every method of a batch does the same to the batch of each task.
"""

import collections
import dataclasses
import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Self

import dm_env
import numpy as np
import numpy.typing as npt
from dm_env import specs

from limberjack.rl import guards
from limberjack.rl.action_specs import as_numbers, not_finite
from limberjack.rl.batch_contract import Batch, RowNumbers
from limberjack.rl.copies import control_of
from limberjack.rl.represented import Description
from limberjack.rl.reward_terms import has_goal
from limberjack.rl.snapshot import Snapshot, as_snapshot
from limberjack.rl.threads import RowThreads
from limberjack.utils.arrays import Quantity, any_of
from limberjack.utils.cores import usable_cores

__all__ = [
    "MOST_THREADS",
    "OBSERVATIONS",
    "ManySnapshot",
    "ManyTasks",
    "TaskOfMany",
    "TaskStatistics",
    "threads_of_one",
]

OBSERVATIONS = "observations"  # the name of the padded array in a time step
MOST_THREADS = 8  # that step the batches
_LISTED = 3  # tasks that the name of the batch lists
_SHARE_OF_LAST = 0.1  # of the last step in the expected time of the next one
_FIRST, _LAST = int(dm_env.StepType.FIRST), int(dm_env.StepType.LAST)


def threads_of_one(num_threads: int | None, num_tasks: int) -> int:
    """The number of threads for the batch of each of several tasks.

    Raises:
      ValueError: `num_threads`, of all together, is not a whole number of at least 1.
    """
    given = usable_cores() if num_threads is None else num_threads
    return max(1, guards.at_least_one("num_threads", given) // num_tasks)


@dataclasses.dataclass(frozen=True)
class TaskOfMany:
    """The facts that rows of one task have in common.

    Attributes:
      name: such as 'cheetah:run'.
      rows: of the whole.
      observation_size: numbers of an observation, the first of a row.
      action_size: numbers of an action, the first of a row.
      action_spec: of one row's action.
      episode_length: actions of an episode; infinite without a limit.
      control_timestep: seconds between two control steps; NaN if the task does not say it.
      action_repeat: control steps per action.
      has_goal: whether steps of the task say if they reached a goal; see `Batch.success`.
      instruction: a sentence that says what is wanted, as the task's function has it.
    """

    name: str
    rows: slice
    observation_size: int
    action_size: int
    action_spec: specs.BoundedArray
    episode_length: float
    control_timestep: float
    action_repeat: int
    has_goal: bool
    instruction: str

    @classmethod
    def of(cls, batch: Batch, first_row: int, instruction: str = "") -> Self:
        """The facts of a batch whose rows begin with `first_row` of the whole."""
        spec = batch.single_action_spec()
        shapes = [one.shape[1:] for one in batch.observation_spec().values()]
        return cls(
            batch.name,
            slice(first_row, first_row + batch.num_envs),
            sum(map(math.prod, shapes)),
            math.prod(spec.shape),
            spec,
            _actions(batch.step_limit, batch.action_repeat),
            batch.control_timestep(),
            batch.action_repeat,
            has_goal(_task_of(batch)),
            instruction or f"{batch.name.replace(':', ' ').replace('_', ' ')}.",
        )

    @property
    def discount(self) -> float:
        """A discount per action for episodes of L actions, as TD-MPC2, MR.Q and SimbaV2 have it.

        (L/5 - 1) / (L/5), but at least 0.95 and at most 0.995; 0.995 for tasks without a limit.
        """
        fifth = self.episode_length / 5
        return 0.995 if math.isinf(fifth) else min(max((fifth - 1) / fifth, 0.95), 0.995)


@dataclasses.dataclass(frozen=True)
class TaskStatistics:
    """Sums over the finished episodes of one task that were played from their start.

    Attributes:
      episodes: that have finished.
      mean_return: of rewards; NaN without episodes.
      mean_length: actions; NaN without episodes.
      success: share of them whose last step reached the goal; None without a goal or episodes.
      diverged: episodes that ended because the simulation diverged.
    """

    episodes: int
    mean_return: float
    mean_length: float
    success: float | None
    diverged: int

    def __add__(self, other: "TaskStatistics") -> "TaskStatistics":
        """The statistics of the episodes of both."""
        if not (self.episodes and other.episodes):
            return self if self.episodes else other
        episodes = self.episodes + other.episodes
        shares = self.episodes / episodes, other.episodes / episodes

        def mean(mine: float, its: float) -> float:
            return shares[0] * mine + shares[1] * its

        has_goal = self.success is not None and other.success is not None
        return TaskStatistics(
            episodes,
            mean(self.mean_return, other.mean_return),
            mean(self.mean_length, other.mean_length),
            mean(self.success or 0.0, other.success or 0.0) if has_goal else None,
            self.diverged + other.diverged,
        )


@dataclasses.dataclass(frozen=True, repr=False)
class ManySnapshot(Snapshot):
    """State of rows of several tasks; `parts` has the snapshot of each task's rows.

    Counters and streams of `Snapshot` are those of all rows, one after the other.
    """

    parts: tuple[Snapshot, ...] = ()

    @classmethod
    def of(cls, parts: Iterable[Snapshot]) -> "ManySnapshot":
        """The snapshot of rows of several tasks."""
        parts = tuple(parts)
        return cls(
            {"tasks": tuple(part.name for part in parts)},
            {},
            np.concatenate([part.step_count for part in parts]),
            np.concatenate([part.begins for part in parts]),
            [streams for part in parts for streams in part.streams],
            name=_named([part.name for part in parts]),
            parts=parts,
        )

    def part(self, rows: int | np.ndarray) -> Snapshot:
        """See `Snapshot`; of rows of a single task it is the snapshot of that task.

        Raises:
          IndexError: there is no such row.
          ValueError: the numbers are not in their order.
        """
        numbers = np.atleast_1d(rows)
        bounds = np.cumsum([0, *map(len, self.parts)])
        if numbers.size and (numbers.min() < 0 or numbers.max() >= bounds[-1]):
            raise IndexError(f"rows are {rows!r}; expected numbers from 0 to {bounds[-1] - 1}")
        if (np.diff(numbers) < 0).any():
            raise ValueError(
                f"rows are {rows!r}; expected them in their order, in which the rows of each task "
                "stay together"
            )
        chosen = [
            (part, numbers[(numbers >= first) & (numbers < first + len(part))] - first)
            for part, first in zip(self.parts, bounds[:-1].tolist(), strict=True)
        ]
        taken = [part.part(here) for part, here in chosen if here.size]
        if not taken:
            return self.parts[0].part(numbers)
        return taken[0] if len(taken) == 1 else ManySnapshot.of(taken)


class _Found:
    """The time step of all rows, to which the batch of each task adds its own."""

    def __init__(self, batch: "ManyTasks") -> None:
        self._batch = batch
        rows = batch.num_envs
        self.step_type = np.zeros(rows, int)
        self.reward, self.discount = np.zeros(rows), np.ones(rows)
        self._observations = np.zeros(batch.observation_mask.shape)

    def take(self, number: int, time_step: dm_env.TimeStep) -> None:
        """Adds the time step of the batch of one task."""
        rows = self._batch.rows_of[number]
        self.step_type[rows] = time_step.step_type
        self.reward[rows], self.discount[rows] = time_step.reward, time_step.discount
        start, padded = 0, self._observations[rows]
        for values in time_step.observation.values():
            flat = values.reshape(len(values), -1)
            stop = start + flat.shape[1]
            padded[:, start:stop] = flat
            start = stop

    def time_step(self) -> dm_env.TimeStep:
        """The time step; the masks in it are the batch's own, which cannot be written to."""
        batch = self._batch
        observation = collections.OrderedDict(
            {
                OBSERVATIONS: self._observations,
                "observation_mask": batch.observation_mask,
                "action_mask": batch.action_mask,
                "task_id": batch.task_ids,
            }
        )
        return dm_env.TimeStep(self.step_type, self.reward, self.discount, observation)


class ManyTasks(Batch):
    """Batches of several tasks as one; see the module's docstring.

    Attributes:
      parts: the batch of each task that has rows here.
      rows_of: the rows of each of these batches.
      tasks: the facts of all tasks, those without rows here included; see `TaskOfMany`.
      task_ids: the number in `tasks` of each row's task, (num_envs,).
      observation_mask: which numbers of `observations` belong to a row's task, (num_envs, D).
      action_mask: which numbers of actions the row's task takes, (num_envs, A).
    """

    flat_names = (OBSERVATIONS,)

    def __init__(
        self,
        batches: Sequence[Batch],
        tasks: Sequence[TaskOfMany] | None = None,
        num_threads: int | None = None,
    ) -> None:
        """Takes over batches of different tasks.

        Args:
          batches: of either kind, not to be used elsewhere; best made with `threads_of_one`.
          tasks: the tasks that the arrays are for, if some have no rows here, as in the half of a
            batch; None for those of the batches.
          num_threads: that step the batches; None for as many as there are cores, at most 8.

        Raises:
          TypeError: something is not a batch.
          ValueError: there is none, or two are of one task, or they have pictures, or they repeat
            actions differently, or no action is within the bounds of all tasks.
        """
        self.parts = tuple(_checked(batches))
        sizes = [part.num_envs for part in self.parts]
        bounds = np.cumsum([0, *sizes]).tolist()
        self.rows_of = tuple(map(slice, bounds[:-1], bounds[1:]))
        self.num_envs = bounds[-1]
        if tasks is None:
            tasks = [TaskOfMany.of(*pair) for pair in zip(self.parts, bounds[:-1], strict=True)]
        self.tasks = tuple(tasks)
        self.name = _named([task.name for task in self.tasks])
        self._action_repeat = self.parts[0].action_repeat
        names = [task.name for task in self.tasks]
        of_parts = [names.index(part.name) for part in self.parts]
        self._tasks_of = [self.tasks[number] for number in of_parts]
        self._set_masks(np.repeat(of_parts, sizes))
        self._action_spec = guards.batched_spec(self.single_action_spec(), self.num_envs)
        given = usable_cores() if num_threads is None else num_threads
        threads = min(guards.at_least_one("num_threads", given), MOST_THREADS, len(self.parts))
        self._threads = RowThreads(len(self.parts), threads)
        self._seconds = np.zeros(len(self.parts))  # of a step, as expected
        # Draws from a stream that environments share have an order.
        self._is_in_order = any(getattr(part, "draws_globally", None) for part in self.parts)
        # What a reset shows of each task: its own last one, until a step.
        self._present: list[dm_env.TimeStep | None] = [None] * len(self.parts)
        self._rows_with: dict[str, np.ndarray] = {}  # masks by term
        self.diverged = np.zeros(self.num_envs, bool)
        self._use = guards.OneUser("batch")
        self.clear_statistics()

    def _set_masks(self, task_ids: np.ndarray) -> None:
        self.task_ids = task_ids
        sizes = np.array([(task.observation_size, task.action_size) for task in self.tasks])
        widths = sizes.max(axis=0)
        self.observation_mask, self.action_mask = (
            np.arange(width) < sizes[task_ids, which, None] for which, width in enumerate(widths)
        )
        for array in (self.task_ids, self.observation_mask, self.action_mask):
            array.flags.writeable = False

    def reset(
        self, ids: RowNumbers = None, seeds: Sequence[int | None] | None = None
    ) -> dm_env.TimeStep:
        """See `Batch`."""
        rows = self._numbers(ids)
        of_rows = guards.seeds_of_rows(seeds, len(rows))
        of_parts = dict(self._split(rows))
        with self._use:

            def begin(number: int) -> None:
                local, index = of_parts.get(number, (np.zeros(0, int), []))
                if not len(local) and self._present[number] is not None:
                    return
                self._present[number] = self.parts[number].reset(local, [of_rows[i] for i in index])

            self._do(begin)
            self._returns[rows], self._lengths[rows], self._are_whole[rows] = 0.0, 0, True
            self.diverged[rows] = False
            found = _Found(self)
            for number, time_step in enumerate(self._present):
                assert time_step is not None
                found.take(number, time_step)
        return found.time_step()

    def step(self, actions: npt.ArrayLike) -> dm_env.TimeStep:
        """See `Batch`.

        Args:
          actions: numbers, (num_envs, A); those that `action_mask` leaves out are ignored.
        """
        with self._use:
            given = self._checked_actions(actions)
            found, diverged = _Found(self), np.zeros(self.num_envs, bool)
            self._present = [None] * len(self.parts)

            def step(number: int) -> None:
                began = time.thread_time()
                part, task = self.parts[number], self._tasks_of[number]
                rows = self.rows_of[number]
                own = given[rows, : task.action_size]
                found.take(number, part.step(own.reshape(len(own), *task.action_spec.shape)))
                diverged[rows] = part.diverged
                more = time.thread_time() - began - self._seconds[number]
                self._seconds[number] += _SHARE_OF_LAST * more

            self._do(step)
            self.diverged = diverged
            self._count(found)
        return found.time_step()

    def _checked_actions(self, actions: npt.ArrayLike) -> np.ndarray:
        """The actions as an array, of which those are finite that tasks take."""
        given = as_numbers(actions)
        if given.shape != self.action_mask.shape:
            raise ValueError(
                f"actions have shape {given.shape}; expected {self.action_mask.shape}: one row for "
                "each environment, as long as the longest action; nothing was stepped"
            )
        if not_finite(given) is not None:
            taken = np.where(self.action_mask, given, 0)
            guards.check_actions(taken, self.num_envs, self.begins, self.first_row)
        return given

    def _do(self, job: Callable[[int], object]) -> None:
        """Calls `job(number)` for the batch of each task, the longest first.

        After an error or an interrupt every row begins an episode with the next step.
        """
        order: Sequence[int] = np.argsort(-self._seconds, kind="stable").tolist()
        threads = self._threads.num_threads
        if self._is_in_order:
            order, threads = range(len(self.parts)), 1
        try:
            errors = self._threads.share(job, order, threads)
            if errors:
                raise self._described(
                    *min(errors, key=lambda one: (isinstance(one[1], Exception), one[0]))
                )
        except BaseException:
            self.restart()
            raise

    def _described(self, number: int, error: BaseException) -> BaseException:
        """The error of the batch of one task, with a note of its rows."""
        rows = self.rows_of[number]
        note = (
            f"raised by {self.parts[number].name}, rows {rows.start + self.first_row} to "
            f"{rows.stop - 1 + self.first_row}; the rows of all tasks begin an episode with the "
            "next step"
        )
        if isinstance(error, Exception) and note not in getattr(error, "__notes__", ()):
            error.add_note(note)
        return error

    def restart(self) -> None:
        """See `Batch`."""
        self._present = [None] * len(self.parts)
        for part in self.parts:
            part.restart()

    def _count(self, found: _Found) -> None:
        """Adds a step to the episodes of rows, and those that end to the statistics."""
        first, last = found.step_type == _FIRST, found.step_type == _LAST
        for values in (self._returns, self._lengths):
            values[first] = 0
        self._are_whole[first] = True
        self._returns += found.reward
        self._lengths += ~first
        if any_of(last):
            success = self.success
            ended = last & self._are_whole
            self._sums["episodes"] += self._of_tasks(ended)
            self._sums["return"] += self._of_tasks(ended, self._returns)
            self._sums["length"] += self._of_tasks(ended, self._lengths)
            self._sums["diverged"] += self._of_tasks(ended & self.diverged)
            if success is not None:
                self._sums["goals"] += self._of_tasks(ended & self.rows_with("success"))
                self._sums["success"] += self._of_tasks(ended & success & ~self.diverged)

    def _of_tasks(self, rows: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
        """The number of rows of a mask, or the sum of their values, for each task."""
        weights = None if values is None else values[rows]
        return np.bincount(self.task_ids[rows], weights, minlength=len(self.tasks))

    def statistics(self) -> dict[str, TaskStatistics]:
        """The statistics of the episodes that have finished, by the name of their task."""
        found = {}
        for number, task in enumerate(self.tasks):
            rows = self.task_ids == number
            if not any_of(rows):
                continue
            sums = {name: float(values[number]) for name, values in self._sums.items()}
            count = sums["episodes"] or math.nan
            found[task.name] = TaskStatistics(
                int(sums["episodes"]),
                sums["return"] / count,
                sums["length"] / count,
                sums["success"] / sums["goals"] if sums["goals"] else None,
                int(sums["diverged"]),
            )
        return found

    def clear_statistics(self) -> None:
        """Begins new statistics; episodes that are running are not among them."""
        names = ("episodes", "return", "length", "goals", "success", "diverged")
        self._sums = {name: np.zeros(len(self.tasks)) for name in names}
        self._returns, self._lengths = np.zeros(self.num_envs), np.zeros(self.num_envs, int)
        self._are_whole = np.zeros(self.num_envs, bool)

    def snapshot(self, rows: RowNumbers = None) -> Snapshot:
        """See `Batch`; of rows of one task, the snapshot that the task's batch makes of them."""
        split = self._split(self._numbers(rows))
        with self._use:
            saved = [self.parts[number].snapshot(local) for number, (local, _) in split]
        if not saved:
            return self.parts[0].snapshot([])
        return saved[0] if len(saved) == 1 else ManySnapshot.of(saved)

    def restore(self, snapshot: Snapshot, rows: RowNumbers = None) -> None:
        """See `Batch`; raises ValueError unless each row is of the task of the snapshot's row."""
        numbers = self._numbers(rows)
        as_snapshot(snapshot)
        given = snapshot.parts if isinstance(snapshot, ManySnapshot) else (snapshot,)
        split = self._split(numbers)
        found = [(part.name, len(part)) for part in given if len(part)]
        expected = [(self.parts[number].name, len(local)) for number, (local, _) in split]
        if found != expected and not (len(split) == len(given) == 1):
            raise ValueError(
                f"the snapshot is of {_counted(found)}; expected {_counted(expected)}, as the rows "
                "to restore have; nothing was restored"
            )
        with self._use:
            done: list[tuple[int, np.ndarray, Snapshot]] = []
            try:
                for (number, (local, _)), saved in zip(split, given, strict=True):
                    part = self.parts[number]
                    before = part.snapshot(local)
                    part.restore(saved, local)
                    done.append((number, local, before))
            except BaseException:  # the tasks before are as they were
                for number, local, before in done:
                    self.parts[number].restore(before, local)
                raise
            for number, _, _ in done:
                self._present[number] = None
            self._are_whole[numbers], self.diverged[numbers] = False, False

    def set_states(
        self, states: Mapping[str, npt.ArrayLike] | Snapshot, rows: RowNumbers = None
    ) -> dm_env.TimeStep:
        """See `Batch`; raises ValueError if a mapping is for rows of several tasks."""
        numbers = self._numbers(rows)
        if isinstance(states, Snapshot):
            self.restore(states, numbers)
            return self.reset([])
        split = self._split(numbers)
        if len(split) > 1:
            names = [self.parts[number].name for number, _ in split]
            raise ValueError(
                f"the states are for rows of {', '.join(names)}, whose positions differ; set those "
                "of one task at a time"
            )
        with self._use:
            for number, (local, _) in split:
                self._present[number] = self.parts[number].set_states(states, local)
        return self.reset([])

    def _split(self, rows: np.ndarray) -> list[tuple[int, tuple[np.ndarray, list[int]]]]:
        """The batches that have some of the rows: their number, and there (rows, positions)."""
        found = []
        for number, own in enumerate(self.rows_of):
            index = np.flatnonzero((rows >= own.start) & (rows < own.stop))
            if index.size:
                found.append((number, (rows[index] - own.start, index.tolist())))
        return found

    def _joined(self, of_part: Callable[[Batch], np.ndarray]) -> np.ndarray:
        return np.concatenate([of_part(part) for part in self.parts])

    @property
    def begins(self) -> np.ndarray:
        """See `Batch`."""
        return self._joined(lambda part: part.begins)

    @property
    def timed_out(self) -> np.ndarray:
        """See `Batch`."""
        return self._joined(lambda part: part.timed_out)

    @property
    def success(self) -> np.ndarray | None:
        """See `Batch`; False in rows of tasks without a goal, which `rows_with` leaves out."""
        found = [part.success for part in self.parts]
        if all(one is None for one in found):
            return None
        reached, have = np.zeros(self.num_envs, bool), np.zeros(self.num_envs, bool)
        for rows, one in zip(self.rows_of, found, strict=True):
            if one is not None:
                reached[rows], have[rows] = one, True
        self._rows_with["success"] = have
        return reached

    @property
    def reward_terms(self) -> dict[str, Quantity]:
        """See `Batch`; zero in rows of tasks without the term, which `rows_with` leaves out."""
        self._rows_with = {n: mask for n, mask in self._rows_with.items() if n == "success"}
        found: dict[str, np.ndarray] = {}
        for rows, part in zip(self.rows_of, self.parts, strict=True):
            for name, values in part.reward_terms.items():
                if name not in found:
                    found[name] = np.zeros(self.num_envs)
                    self._rows_with[name] = np.zeros(self.num_envs, bool)
                found[name][rows] = values
                self._rows_with[name][rows] = True
        return {**found}

    def rows_with(self, term: str) -> np.ndarray:
        """See `Batch`; of the terms that `reward_terms` or `success` had last."""
        mask = self._rows_with.get(term)
        return np.zeros(self.num_envs, bool) if mask is None else mask

    @property
    def randomization(self) -> dict[str, np.ndarray]:
        """See `Batch`; arrays of objects, since the fields of models have different shapes."""
        found: dict[str, np.ndarray] = {}
        for rows, part in zip(self.rows_of, self.parts, strict=True):
            for name, values in part.randomization.items():
                of_all = found.setdefault(name, np.full(self.num_envs, None, object))
                for row, value in zip(range(rows.start, rows.stop), values, strict=True):
                    of_all[row] = value
        return found

    @property
    def first_row(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        """See `Batch`."""
        return self.parts[0].first_row

    @first_row.setter
    def first_row(self, first: int) -> None:  # pyright: ignore[reportIncompatibleVariableOverride]
        for rows, part in zip(self.rows_of, self.parts, strict=True):
            part.first_row = first + rows.start

    @property
    def step_limit(self) -> float:
        """Control steps per episode, infinite if tasks differ; setting it sets it for all."""
        is_common = len({task.episode_length for task in self.tasks}) == 1
        return self.parts[0].step_limit if is_common else math.inf

    @step_limit.setter
    def step_limit(self, limit: float) -> None:
        for part in self.parts:
            part.step_limit = limit
        lengths = {part.name: _actions(limit, part.action_repeat) for part in self.parts}
        self.tasks = tuple(
            dataclasses.replace(task, episode_length=lengths.get(task.name, task.episode_length))
            for task in self.tasks
        )

    @property
    def pixels(self) -> None:
        """See `Batch`; there are none."""
        return

    def draw_every(self, steps: int) -> None:
        """See `Batch`."""
        for part in self.parts:
            part.draw_every(steps)

    def control_timestep(self) -> float:
        """See `Batch`; NaN if tasks differ in it, of which each says its own in `tasks`."""
        self._use.check()
        found = {task.control_timestep for task in self.tasks}
        return found.pop() if len(found) == 1 else math.nan

    def single_action_spec(self) -> specs.BoundedArray:
        """The spec of one row's action, (A,): bounds that all tasks allow which take a number.

        Raises:
          ValueError: tasks allow no common number.
        """
        size = max(task.action_size for task in self.tasks)
        low, high = np.full(size, -np.inf), np.full(size, np.inf)
        for task in self.tasks:
            spec, own = task.action_spec, slice(task.action_size)
            low[own] = np.maximum(low[own], np.broadcast_to(spec.minimum, spec.shape).ravel())
            high[own] = np.minimum(high[own], np.broadcast_to(spec.maximum, spec.shape).ravel())
        if (low > high).any():
            raise ValueError(
                f"no action is within the bounds of all tasks ({self.name}): the number "
                f"{np.flatnonzero(low > high)[0]} has none; make one batch for each task"
            )
        return specs.BoundedArray((size,), float, low, high, name="action")

    def observation_spec(self) -> Mapping[str, specs.Array]:
        """See `Batch`."""
        masks = {"observation_mask": self.observation_mask, "action_mask": self.action_mask}
        return collections.OrderedDict(
            {
                OBSERVATIONS: specs.Array(self.observation_mask.shape, float, OBSERVATIONS),
                **{n: specs.BoundedArray(m.shape, bool, 0, 1, n) for n, m in masks.items()},
                "task_id": specs.BoundedArray(
                    self.task_ids.shape, self.task_ids.dtype, 0, len(self.tasks) - 1, "task_id"
                ),
            }
        )

    def state_sizes(self) -> dict[str, int]:
        """Raises TypeError: they differ between tasks."""
        raise self._differs("the sizes of the state")

    def integration_states(self) -> np.ndarray:
        """Raises TypeError: they differ between tasks."""
        raise self._differs("the integration states")

    def episode_fields(self) -> dict[str, np.ndarray]:
        """Raises TypeError: they differ between tasks."""
        raise self._differs("the fields of the model")

    def _differs(self, what: str) -> TypeError:
        return TypeError(f"{what} differ between tasks: ask the batch of each task, in `parts`")

    def _draw(self, rows: np.ndarray, **kwargs: object) -> np.ndarray:
        split = self._split(rows) or [(0, (rows, []))]
        drawn = [self.parts[number]._draw(own, **kwargs) for number, (own, _) in split]
        return np.concatenate(drawn)

    def _free(self) -> None:
        self._threads.close()
        for part in self.parts:
            part.close()

    def description(self) -> Description:
        """See `Batch`."""
        parts = [part.description() for part in self.parts]
        seeds = [seed for part in parts for seed in part.seeds]
        steps = [step for part in parts for step in part.steps]
        return Description(self.name, self.num_envs, seeds, steps, self.step_limit)


def _checked(batches: Sequence[Batch]) -> Sequence[Batch]:
    """The batches; raises unless they can be one."""
    for batch in batches:
        if not isinstance(batch, Batch) or isinstance(batch, ManyTasks):
            raise TypeError(f"got a {type(batch).__name__}; expected batches of one task each")
        if batch.pixels is not None:
            raise ValueError(
                f"{batch.name} observes pictures, which batches of several tasks do not; leave out "
                "pixels, or make one batch for each task"
            )
    if not batches:
        raise ValueError("there are no batches; expected at least one")
    names = [batch.name for batch in batches]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(f"{twice[0]} is given twice; give it once, with more rows")
    repeats = {batch.name: batch.action_repeat for batch in batches}
    if len({*repeats.values()}) > 1:
        raise ValueError(f"the tasks repeat actions differently: {repeats}; give one action_repeat")
    return batches


def _task_of(batch: Batch) -> object:
    """The task of a batch of either kind; None for environments that have none."""
    environments = getattr(batch, "environments", None)
    return getattr(control_of(environments[0]) if environments else batch, "task", None)


def _actions(steps: float, repeat: int) -> float:
    """The actions of an episode of so many control steps; infinite without a limit."""
    return math.ceil(steps / repeat) if math.isfinite(steps) else math.inf


def _named(names: Sequence[str]) -> str:
    """The names of tasks, or their number if they are many."""
    return ", ".join(names) if len(names) <= _LISTED else f"{len(names)} tasks"


def _counted(rows: Sequence[tuple[str, int]]) -> str:
    """Tasks with their numbers of rows in words."""
    return ", ".join(f"{name} ({count} rows)" for name, count in rows) or "no rows"
