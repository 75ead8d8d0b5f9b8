"""Rows of a batch, compared with dm_control's own environments.

    play = Play(("stacker", "stack_2"), seed=21)
    expected = play.of_dm_control(range(5))
    found = play.of_batch(num_envs=5, num_threads=2, mode=AutoresetMode.SAME_STEP)
    assert not first_difference(found, expected)

A row is a sequence of time steps: a first one, others up to the last one of its episode, the first
one of the next episode, and so on. Gymnasium's autoreset modes return the same sequence at
different times, and it depends only on the row's seed and actions. Therefore one environment of
dm_control for each row, stepped once, serves for batches of any size, number of threads and mode.

The row's actions are a table by position in the sequence. Odd rows are reset in the middle of their
first episode, so that the episodes of a batch end at different times.
"""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from limberjack import gym

from . import twins
from .oracle import BOTH, ours, theirs
from .same import difference

__all__ = ["Between", "Play", "Rows", "first_difference"]

# Kinds of time steps. Gymnasium distinguishes an end by the time limit from one by the task.
# A row that diverges has no further time steps: dm_control raises PhysicsError.
_KINDS = ("first", "mid", "truncated", "terminated", "diverged")
_FIRST, _MID, _TRUNCATED, _TERMINATED, _DIVERGED = range(5)

_DIVERGENCE = tuple(package("rl.control").PhysicsError for package in BOTH)

# Odd rows are reset at a position of their own between these parts of their first episode.
_EARLIEST_RESET, _LATEST_RESET = 1 / 6, 3 / 4

# Called with the number of a step and the environment; returns the environment to go on with.
Between = Callable[[int, gym.VectorEnv], gym.VectorEnv]


@dataclasses.dataclass
class Rows:
    """Sequences of time steps.

    Attributes:
      numbers: of the rows, (rows,).
      fields: kind, reward and each observation by name, (rows, steps, ...).
    """

    numbers: np.ndarray
    fields: dict[str, np.ndarray]

    @classmethod
    def empty(cls, numbers: Iterable[int], steps: int, observation: Mapping[str, Any]) -> "Rows":
        """Room for sequences with the observations of one simulation."""
        chosen = np.array(list(numbers))
        shapes = {"kind": (), "reward": ()} | {n: np.shape(one) for n, one in observation.items()}
        fields = {n: np.zeros((len(chosen), steps, *shape)) for n, shape in shapes.items()}
        return cls(chosen, fields)

    def some(self, numbers: Iterable[int]) -> "Rows":
        """The rows of those numbers."""
        chosen = np.array(list(numbers))
        index = np.searchsorted(self.numbers, chosen)
        return Rows(chosen, {name: values[index] for name, values in self.fields.items()})

    def write(self, where: Any, kind: Any, reward: Any, observation: Mapping[str, Any]) -> None:
        """Stores time steps at an index of (rows, steps)."""
        for name, value in {"kind": kind, "reward": reward, **observation}.items():
            self.fields[name][where] = value


def first_difference(found: Rows, expected: Rows) -> str:
    """Describes the earliest step of any row that differs in a bit; "" if there is none.

    Only the rows of `expected` are compared.
    """
    if list(found.fields) != list(expected.fields):
        return f"fields {list(found.fields)}, dm_control has {list(expected.fields)}"
    found = found.some(expected.numbers)
    places = []
    for name, values in expected.fields.items():
        mine = found.fields[name]
        if mine.shape != values.shape:
            return f"{name}: shape {mine.shape}, dm_control has {values.shape}"
        differs = mine.view(np.int64) != values.view(np.int64)
        rows, steps, *_ = np.nonzero(differs.reshape(*values.shape[:2], -1))
        if len(steps):
            first = np.argmin(steps)
            places.append((int(steps[first]), int(rows[first]), name))
    if not places:
        return ""
    step, row, name = min(places)
    where = f"row {expected.numbers[row]}, step {step}, {name}"
    mine, yours = (rows.fields[name][row, step] for rows in (found, expected))
    if name == "kind":
        mine, yours = _KINDS[int(mine)], _KINDS[int(yours)]
    return difference(mine, yours, where)


def _position(stream: np.random.RandomState) -> int:
    """The position of a stream in its current block of numbers."""
    _, _, position, *_ = stream.get_state(legacy=True)
    return int(position)


@dataclasses.dataclass(frozen=True)
class Play:
    """A task with seeds and actions, from which either package makes the same rows.

    Attributes:
      task: domain and task.
      seed: row i has seed + i.
      steps: length of a row's sequence.
      episode: length of an episode, control steps.
      kwargs: arguments of the task's factory.
      environment_kwargs: arguments of the environment.
    """

    task: tuple[str, str]
    seed: int = 0
    steps: int = 300
    episode: int = 120
    kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    environment_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def where(self) -> str:
        """The task and the seed, for messages."""
        return f"{':'.join(self.task)}, seed {self.seed}"

    @functools.cached_property
    def _example(self) -> Any:
        return ours("suite").load(*self.task, dict(self.kwargs), dict(self.environment_kwargs))

    @functools.cached_property
    def _arguments(self) -> dict[str, Any]:
        return {"time_limit": self.episode * self._example.control_timestep(), **self.kwargs}

    @functools.cached_property
    def _limit(self) -> float:
        limit = self.load(ours, None).step_limit
        return float("inf") if limit is None else limit

    def load(self, package: Callable[[str], Any], random: Any) -> Any:
        """The single environment of a package, with a seed or stream."""
        arguments = {"random": random, **self._arguments}
        return package("suite").load(*self.task, arguments, dict(self.environment_kwargs))

    def make(self, num_envs: int, num_threads: int, mode: AutoresetMode) -> gym.VectorEnv:
        """Limberjack's vector environment."""
        return gym.load_vector(
            *self.task,
            num_envs,
            num_threads=num_threads,
            autoreset_mode=mode,
            task_kwargs=self._arguments,
            environment_kwargs=self.environment_kwargs,
        )

    def _actions(self, row: int) -> np.ndarray:
        """The row's actions by position, (steps, ...)."""
        chosen = twins.actions(self._example.action_spec(), "mixed", self.seed + row)
        return np.array(list(itertools.islice(chosen, self.steps)))

    def _reset_at(self, row: int) -> int:
        """The position of the row's reset in mid-episode; -1 if there is none."""
        first, last = (int(part * self.episode) for part in (_EARLIEST_RESET, _LATEST_RESET))
        return first + 7 * row % (last - first) if row % 2 else -1

    def of_dm_control(
        self, numbers: Iterable[int], before_episode: Callable[[Any, int], None] | None = None
    ) -> Rows:
        """Rows of those numbers, one after the other.

        `before_episode` is called with the environment and the row's number before each reset.
        """
        numbers = list(numbers)
        return self._of_each(numbers, self._environments(numbers), before_episode)

    def of_singles(self, numbers: Iterable[int]) -> Rows:
        """The same from Limberjack's single environments."""
        numbers = list(numbers)
        return self._of_each(numbers, (self.load(ours, self.seed + row) for row in numbers))

    def _of_each(
        self,
        numbers: list[int],
        environments: Iterable[Any],
        before_episode: Callable[[Any, int], None] | None = None,
    ) -> Rows:
        rows: Rows | None = None
        for index, env in enumerate(environments):
            steps = self._steps(env, numbers[index], before_episode)
            for position, (kind, step) in enumerate(steps):
                if kind == _DIVERGED:
                    assert rows is not None
                    rows.fields["kind"][index, position] = kind
                    break
                rows = rows or Rows.empty(numbers, self.steps, step.observation)
                rows.write((index, position), kind, step.reward or 0.0, step.observation)
        assert rows is not None
        return rows

    def _environments(self, numbers: list[int]) -> Iterator[Any]:
        """dm_control's environment of each row: one for all, with another stream, where possible.

        Compiling a model takes longer than the row's steps. A task whose factory draws, such as the
        stiffnesses of lqr, needs an environment of its own for each row.
        """
        env: Any = None
        factory_draws = False
        for row in numbers:
            stream, fresh = (np.random.RandomState(self.seed + row) for _ in range(2))
            if env is None or factory_draws:
                env = self.load(theirs, stream)
                factory_draws = _position(stream) != _position(fresh)
            env.task._random = stream
            yield env

    def _steps(
        self, env: Any, row: int, before_episode: Callable[[Any, int], None] | None
    ) -> Iterator[tuple[int, Any]]:
        """Kinds and time steps of a row."""
        is_over, count = True, 0
        for position, action in enumerate(self._actions(row)):
            if is_over or position == self._reset_at(row):
                if before_episode is not None:
                    before_episode(env, row)
                step, count = env.reset(), 0
            else:
                try:
                    step, count = env.step(action), count + 1
                except _DIVERGENCE:
                    yield _DIVERGED, None
                    return
            is_over = step.last()
            ended = _TRUNCATED if count >= self._limit else _TERMINATED
            yield (_FIRST if step.first() else ended if is_over else _MID), step

    def of_batch(
        self,
        num_envs: int,
        num_threads: int = 1,
        mode: AutoresetMode = AutoresetMode.NEXT_STEP,
        between: Between | None = None,
    ) -> Rows:
        """All rows of a batch; `between` is called before each step."""
        envs = self.make(num_envs, num_threads, mode)
        actions = np.stack([self._actions(row) for row in range(num_envs)])
        resets = np.array([self._reset_at(row) for row in range(num_envs)])
        observation, _ = envs.reset(seed=self.seed)
        one = {name: values[0] for name, values in observation.items()}
        recorder = _Recorder(Rows.empty(range(num_envs), self.steps, one))
        recorder.add(np.ones(num_envs, bool), _FIRST, 0.0, observation)
        ended = np.zeros(num_envs, bool)
        for number in itertools.count():
            if between is not None:
                envs = between(number, envs)
            due = recorder.position == resets
            if mode is AutoresetMode.DISABLED:
                due |= ended
            if due.any():
                observation, _ = envs.reset(options={"reset_mask": due})
                recorder.add(due, _FIRST, 0.0, observation)
                ended &= ~due
            if recorder.is_full():
                break
            result = envs.step(actions[recorder.next_ones()])
            ended = recorder.add_step(result, begun=ended, mode=mode)
        return recorder.rows


class _Recorder:
    """Writes what a batch returns into the sequences of its rows."""

    def __init__(self, rows: Rows) -> None:
        self.rows = rows
        self.position = np.zeros(len(rows.numbers), int)  # of each row's next time step
        self._steps = rows.fields["kind"].shape[1]

    def is_full(self) -> bool:
        """Whether all sequences are complete; time steps beyond the end are dropped."""
        return bool((self.position >= self._steps).all())

    def next_ones(self) -> tuple[np.ndarray, np.ndarray]:
        """The index of each row's next time step."""
        return np.arange(len(self.position)), np.minimum(self.position, self._steps - 1)

    def add(self, mask: np.ndarray, kind: Any, reward: Any, observation: Mapping[str, Any]) -> None:
        """Adds a time step to the rows of the mask."""
        chosen = np.flatnonzero(mask & (self.position < self._steps))
        kind, reward = (np.broadcast_to(values, mask.shape)[chosen] for values in (kind, reward))
        values = {name: one[chosen] for name, one in observation.items()}
        self.rows.write((chosen, self.position[chosen]), kind, reward, values)
        self.position[mask] += 1

    def _end(self, diverged: np.ndarray) -> None:
        """Ends the sequences of rows that have diverged."""
        chosen = np.flatnonzero(diverged & (self.position < self._steps))
        self.rows.fields["kind"][chosen, self.position[chosen]] = _DIVERGED
        self.position[chosen] = self._steps

    def add_step(self, result: Any, begun: np.ndarray, mode: AutoresetMode) -> np.ndarray:
        """Adds the result of a step; returns the mask of rows that the next step resets.

        Args:
          result: of `VectorEnv.step`.
          begun: mask of rows that the step reset.
          mode: the autoreset mode.
        """
        observation, reward, terminated, truncated, info = result
        self._end(info["diverged"])
        everyone = np.ones(len(reward), bool)
        kind = np.select([begun, terminated, truncated], [_FIRST, _TERMINATED, _TRUNCATED], _MID)
        ended = terminated | truncated
        if mode is not AutoresetMode.SAME_STEP or not ended.any():
            self.add(everyone, kind, reward, observation)
            return ended
        last = {name: values.copy() for name, values in observation.items()}
        for row in np.flatnonzero(ended):
            for name, value in info["final_obs"][row].items():
                last[name][row] = value
        self.add(everyone, kind, reward, last)
        self.add(ended, _FIRST, 0.0, observation)
        return np.zeros(len(ended), bool)
