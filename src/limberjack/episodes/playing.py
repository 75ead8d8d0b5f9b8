"""`play`: the loop that plays episodes, in the rows of a batch of either kind.

    actor = policies.find("random", environment)
    with contextlib.closing(batch_for(build, actor, seeds)) as batch:
        for ended in play(batch, actor, seeds, Kept(states=True)):
            for episode in ended:
                print(episode.seed, episode.total)

Everything that plays episodes uses this loop; `Step` lets a caller watch it. Each row plays one
seed's episode, and a row whose episode has ended takes the next seed. Seeds that are equal modulo
64 are played one after the other, so that an actor can use `seed % 64` as a row number. Each
episode equals that of a single environment with its seed, bit for bit, if the policy's action for a
row does not depend on the other rows.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import dm_env
import numpy as np
from dm_env import specs

from limberjack.episodes.episode import Episode, Kept
from limberjack.policies import ROWS, Act, Actor
from limberjack.policies.actors import Deferred, EachRow
from limberjack.rl.batch_contract import Batch
from limberjack.rl.batches import batch_of
from limberjack.rl.builds import Build
from limberjack.rl.observations import of_rows
from limberjack.rl.pixels import PIXELS_KEY
from limberjack.rl.rows import RowsEnvironment
from limberjack.rl.shared_streams import GLOBAL_STREAMS, fingerprint
from limberjack.see.report import Step as ShownStep

__all__ = ["OnStep", "Step", "batch_for", "play", "recorded"]

_LAST = int(dm_env.StepType.LAST)
_FEW_STEPS = 1000  # for which there is room at first, as in an episode of the suite


@dataclasses.dataclass(frozen=True)
class Step:
    """The beginning of episodes in some rows, or a step of all rows that run.

    Attributes:
      rows: numbers of the rows that began or were stepped.
      time_step: of all rows.
      actions: of all rows; None at the beginning of episodes.
      seeds: of each row's episode, (num_envs,).
      numbers: steps so far of each row's episode, (num_envs,).
      totals: the return so far of each row's episode, (num_envs,).
    """

    rows: np.ndarray
    time_step: dm_env.TimeStep
    actions: np.ndarray | None
    seeds: np.ndarray
    numbers: np.ndarray
    totals: np.ndarray

    @property
    def count(self) -> int:
        """The number of steps of environments; 0 at the beginning of episodes."""
        return 0 if self.actions is None else len(self.rows)

    def of_row(self, row: int) -> ShownStep:
        """The step of a row, for what shows one episode."""
        taken, observed = self.time_step, self.time_step.observation
        observation = type(observed)({name: value[row] for name, value in observed.items()})
        time_step = dm_env.restart(observation)
        if self.actions is not None:
            kind = dm_env.StepType(int(taken.step_type[row]))
            reward, discount = float(taken.reward[row]), float(taken.discount[row])
            time_step = dm_env.TimeStep(kind, reward, discount, observation)
        action = None if self.actions is None else self.actions[row]
        return ShownStep(int(self.numbers[row]), float(self.totals[row]), time_step, action)


OnStep = Callable[[Step], object]


def batch_for(
    build: Build | dm_env.Environment,
    actor: Actor,
    seeds: Sequence[int],
    num_threads: int | None = None,
    on_divergence: str = "end",
    vectorised: bool | None = None,
) -> Batch:
    """A batch in which an actor can play seeds' episodes: vectorised if that changes no number.

    Args:
      build: makes the environments, or one to copy.
      actor: one that plays alone gets one row, a complete environment.
      seeds: of the episodes; what a user's function makes of each of them is compared first.
      num_threads: number of threads that step the rows; by default one per usable core.
      on_divergence, vectorised: see `rl.batch_of`.

    Raises:
      ValueError, TypeError: the environments cannot be made or do not agree in their specs, or
        `vectorised` is True and cannot be.
    """
    if isinstance(build, Build) and build.original is None:
        build = build.for_seeds(seeds)
    how = {"seed": 0, "action_repeat": 1, "on_divergence": on_divergence}
    if actor.plays_alone:
        return batch_of(build, 1, 1, vectorised=False, **how)
    return batch_of(build, min(ROWS, len(seeds)), num_threads, vectorised=vectorised, **how)


def play(
    batch: Batch,
    actor: Actor,
    seeds: Sequence[int],
    kept: Kept | None = None,
    *,
    action_repeat: int = 1,
    most_steps: float = math.inf,
    on_step: OnStep | None = None,
    watches_draws: bool = False,
) -> Iterator[list[Episode]]:
    """The first episode of each seed, in one list for all that end with the same step.

    Episodes lack the kinds of their starts (`episodes.starts`).

    Args:
      batch: from `batch_for`; it is not closed.
      actor: acts in all rows.
      seeds: at least one.
      kept: what is kept of each step besides rewards; None for nothing.
      action_repeat: control steps per action. Episodes count control steps; pixels are those of the
        steps at which the actor acts.
      most_steps: after so many steps of an episode it is cut off, and is returned without an end.
      on_step: called as episodes begin, and after each step.
      watches_draws: raise if a step draws from a global stream, as a user's environment may.

    Raises:
      PolicyError: the policy returned no valid action.
      PhysicsError: a row diverged, if the batch raises then.
      ValueError: a step draws from a global stream.
    """
    if isinstance(actor, Deferred) and action_repeat != 1:
        assert isinstance(batch, RowsEnvironment)  # as it plays alone
        actor = actor.found(batch.environments[0])  # which leaves repeating to the batch
    batch.draw_every(action_repeat)
    playing = _Playing(batch, actor, seeds, kept, action_repeat, most_steps, on_step)
    if watches_draws:
        playing.step = _watching_draws(batch.step)
    return playing.episodes()


_BatchStep = Callable[[np.ndarray], dm_env.TimeStep]


def _watching_draws(step: _BatchStep) -> _BatchStep:
    """The function, which raises ValueError if it draws from a global stream."""

    def watched(actions: np.ndarray) -> dm_env.TimeStep:
        before = {name: fingerprint(stream) for name, stream in GLOBAL_STREAMS.items()}
        time_step = step(actions)
        for name, stream in GLOBAL_STREAMS.items():
            if fingerprint(stream) != before[name]:
                error = ValueError(
                    f"a step draws from {name}, so an episode does not depend on its seed alone: "
                    "draw from task.random, which has the seed"
                )
                error.add_note("the environment")
                raise error
        return time_step

    return watched


class _Playing:
    """A batch that plays one episode per seed."""

    def __init__(
        self,
        batch: Batch,
        actor: Actor,
        seeds: Sequence[int],
        kept: Kept | None,
        action_repeat: int,
        most_steps: float,
        on_step: OnStep | None,
    ) -> None:
        rows = batch.num_envs
        self._batch = batch
        self.step: _BatchStep = batch.step
        self._actor = actor
        self._action_repeat = action_repeat
        self._most_steps = most_steps
        self._on_step = on_step
        self._actions = np.zeros(batch.action_spec().shape)
        self._waiting = list(seeds)
        self._running = np.zeros(rows, bool)
        self._seeds = np.zeros(rows, np.int64)
        self._lengths = np.zeros(rows, int)
        self._totals = np.zeros(rows)
        most = min(batch.step_limit, most_steps)
        capacity = math.ceil(min(most, _FEW_STEPS)) if most < math.inf else _FEW_STEPS
        self._rewards = _Rows(rows, capacity)
        self._steps = None if kept is None else _Steps(batch, kept, capacity)

    def episodes(self) -> Iterator[list[Episode]]:
        time_step = self._begin()
        while self._running.any():
            assert time_step is not None
            running = np.flatnonzero(self._running)
            actions = self._acted(time_step, running)
            time_step = self.step(actions)
            self._record(running, actions, time_step)
            is_over = time_step.step_type[running] == _LAST
            ended = running[is_over | (self._lengths[running] >= self._most_steps)]
            if ended.size:
                yield [self._episode(row) for row in ended.tolist()]
                self._running[ended] = False
                time_step = self._begin() or time_step

    def _acted(self, time_step: dm_env.TimeStep, running: np.ndarray) -> np.ndarray:
        """The actions of all rows; each is repeated for some control steps."""
        if self._action_repeat == 1:
            return self._actor.act(time_step.observation, running)
        acting = running[self._lengths[running] % self._action_repeat == 0]
        if acting.size:
            self._actions[acting] = self._actor.act(time_step.observation, acting)[acting]
        return self._actions.copy()

    def _begin(self) -> dm_env.TimeStep | None:
        """Begins the next seeds' episodes in idle rows; None if no seed can begin now."""
        idle = np.flatnonzero(~self._running)
        seeds = self._taken(len(idle))
        taking = idle[: len(seeds)]
        if not seeds:
            return None
        self._running[taking] = True
        self._seeds[taking] = seeds
        self._lengths[taking] = 0
        self._totals[taking] = 0.0
        time_step = self._batch.reset(taking, seeds=seeds)
        if self._steps is not None:
            self._steps.begin(taking, time_step.observation)
        if self._on_step is not None:
            self._on_step(self._step(taking, time_step, None))
        self._actor.begin(self._batch, taking, seeds)
        return time_step

    def _taken(self, most: int) -> list[int]:
        """Takes the next waiting seeds whose remainders modulo 64 no running seed has."""
        occupied = set((self._seeds[self._running] % ROWS).tolist())
        taken: list[int] = []
        skipped: list[int] = []
        for seed in self._waiting:
            if len(taken) == most:
                break
            is_free = seed % ROWS not in occupied
            occupied.add(seed % ROWS)
            (taken if is_free else skipped).append(seed)
        self._waiting = skipped + self._waiting[len(taken) + len(skipped) :]
        return taken

    def _record(self, running: np.ndarray, actions: np.ndarray, time_step: dm_env.TimeStep) -> None:
        """Records a step."""
        lengths = self._lengths[running]
        self._rewards.put(running, lengths, time_step.reward[running])
        if self._steps is not None:
            self._steps.add(running, lengths, actions, time_step)
        self._lengths[running] += 1
        if self._on_step is not None:
            self._totals[running] += time_step.reward[running]
            self._on_step(self._step(running, time_step, actions))

    def _step(
        self, rows: np.ndarray, time_step: dm_env.TimeStep, actions: np.ndarray | None
    ) -> Step:
        seeds, lengths, totals = self._seeds.copy(), self._lengths.copy(), self._totals.copy()
        return Step(rows, time_step, actions, seeds, lengths, totals)

    def _episode(self, row: int) -> Episode:
        length = int(self._lengths[row])
        episode = Episode(
            int(self._seeds[row]),
            None,
            self._rewards.of(row, length),
            bool(self._batch.diverged[row]),
        )
        return episode if self._steps is None else self._steps.complete(episode, row, length)


class _Rows:
    """Numbers of all rows and steps; it grows with the longest episode."""

    def __init__(
        self, rows: int, steps: int, shape: Sequence[int] = (), dtype: np.dtype | type = float
    ) -> None:
        self._values = np.zeros((rows, steps, *shape), dtype)

    def put(self, rows: np.ndarray, steps: np.ndarray, values: np.ndarray | bool) -> None:
        """Stores a step's numbers in rows."""
        room = self._values.shape[1]
        if steps.max() >= room:
            more = np.zeros_like(self._values)
            self._values = np.concatenate([self._values, more], axis=1)
        self._values[rows, steps] = values

    def repeat(self, row: int, step: int) -> None:
        """Stores a step's numbers again, for the next step."""
        self._values[row, step + 1] = self._values[row, step]

    def of(self, row: int, steps: int) -> np.ndarray:
        """A copy of the numbers of a row's first steps."""
        return self._values[row, :steps].copy()


class _Steps:
    """Everything that is kept of steps besides their rewards."""

    def __init__(self, batch: Batch, kept: Kept, capacity: int) -> None:
        rows = batch.num_envs
        self._batch = batch
        self._kept = kept
        self._capacity = capacity
        self._actions = _Rows(rows, capacity, batch.action_spec().shape[1:])
        self._terminated, self._truncated, self._success = (
            _Rows(rows, capacity, dtype=bool) for _ in range(3)
        )
        self._observations: dict[str, _Rows] = {}
        self._states: _Rows | None = None
        self._fields: dict[str, np.ndarray] = {}
        self._has_goal = False

    def begin(self, rows: np.ndarray, observation: Mapping[str, np.ndarray]) -> None:
        """Keeps the starts of episodes in rows."""
        self._observe(rows, np.zeros(len(rows), int), observation)
        for name, values in self._batch.episode_fields().items():
            self._fields.setdefault(name, np.zeros_like(values))[rows] = values[rows]

    def add(
        self,
        rows: np.ndarray,
        steps: np.ndarray,
        actions: np.ndarray,
        time_step: dm_env.TimeStep,
    ) -> None:
        """Keeps a step of rows; `steps` has the number of steps before it."""
        batch = self._batch
        last, truncated = time_step.step_type == _LAST, batch.timed_out
        self._actions.put(rows, steps, actions[rows])
        self._truncated.put(rows, steps, (last & truncated)[rows])
        self._terminated.put(rows, steps, (last & ~truncated)[rows])
        reached = batch.success
        if reached is not None:
            self._has_goal = True
            self._success.put(rows, steps, (reached & ~batch.diverged)[rows])
        self._observe(rows, steps + 1, time_step.observation)
        for row in rows[batch.diverged[rows]].tolist():
            self._repeat(row, int(steps[rows == row][0]))

    def _repeat(self, row: int, step: int) -> None:
        """Keeps what was seen before a step that diverged, after which nothing is defined."""
        for kept in (*self._observations.values(), self._states):
            if kept is not None:
                kept.repeat(row, step)

    def complete(self, episode: Episode, row: int, length: int) -> Episode:
        """The episode of a row, with its steps."""
        return dataclasses.replace(
            episode,
            actions=self._actions.of(row, length),
            terminated=self._terminated.of(row, length),
            truncated=self._truncated.of(row, length),
            success=self._success.of(row, length) if self._has_goal else None,
            observations={n: v.of(row, length + 1) for n, v in self._observations.items()},
            states=None if self._states is None else self._states.of(row, length + 1),
            fields={name: values[row].copy() for name, values in self._fields.items()},
        )

    def _observe(
        self, rows: np.ndarray, steps: np.ndarray, observation: Mapping[str, np.ndarray]
    ) -> None:
        for name, values in self._in_form(observation).items():
            if name not in self._observations:
                dtype = self._kept.observed_type(values.dtype)
                shape = values.shape[1:]
                self._observations[name] = _Rows(len(values), self._capacity + 1, shape, dtype)
            self._observations[name].put(rows, steps, values[rows])
        if self._kept.pixels is not None:
            pictures = self._batch.render(rows, **self._kept.pixels.render_kwargs)
            if PIXELS_KEY not in self._observations:
                form = (self._capacity + 1, pictures.shape[1:], pictures.dtype)
                self._observations[PIXELS_KEY] = _Rows(self._batch.num_envs, *form)
            self._observations[PIXELS_KEY].put(rows, steps, pictures)
        if self._kept.states:
            states = self._batch.integration_states()
            if self._states is None:
                self._states = _Rows(len(states), self._capacity + 1, states.shape[1:])
            self._states.put(rows, steps, states[rows])

    def _in_form(self, observation: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """A batch's observation, joined into one array where that is wanted."""
        if not self._kept.flat:
            return observation
        return of_rows(observation, self._batch.num_envs, flat=True)


def recorded(actions: Mapping[int, np.ndarray], action_repeat: int = 1) -> Actor:
    """Acts as recorded episodes did; with zeros after their ends.

    Args:
      actions: of each seed, one per control step, (T, ...).
      action_repeat: control steps that share an action.
    """

    def policy(spec: specs.BoundedArray, seed: int) -> Act:
        left = iter(actions[seed][::action_repeat])
        return lambda observation: next(left, np.zeros(spec.shape))

    return EachRow("recorded", None, policy)
