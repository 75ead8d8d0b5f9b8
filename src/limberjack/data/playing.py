"""`play`: the first episodes of up to 64 seeds in a batch, with every step kept.

    episodes = play(environment, actor, range(64), Kept(states=True))

All rows begin together, and a row whose episode has ended is not filled again, so that the episodes
of a file are in memory and no others. `Recorded` acts as recorded episodes did; a policy that
plays one episode at a time is played alone first, and its actions again in a batch.
"""

import contextlib
import math
from collections.abc import Callable, Mapping, Sequence

import dm_env
import numpy as np
from dm_env import specs

from limberjack.data.episode import Episode
from limberjack.data.recipe import Kept
from limberjack.mujoco.simulation import STATE
from limberjack.policies import Act, EnvironmentPolicy, Policy, begin
from limberjack.policies.batched import Actor
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.control import Environment, PhysicsError
from limberjack.rl.observations import of_rows
from limberjack.rollout import run_episode

__all__ = ["Recorded", "actions_of", "play"]

_LAST = int(dm_env.StepType.LAST)

_OnSteps = Callable[[int], object]


def play(
    environment: Environment,
    actor: Actor,
    seeds: Sequence[int],
    kept: Kept,
    num_threads: int | None = None,
    on_steps: _OnSteps | None = None,
    most_steps: int | None = None,
) -> list[Episode]:
    """The episodes of the seeds, in their order, without the kinds of their starts.

    Args:
      environment: has a time limit; it is not changed.
      actor: acts in all rows.
      seeds: from 1 to 64, distinct modulo 64.
      kept: what is kept of each step.
      num_threads: number of threads that step the rows; by default one per usable core.
      on_steps: called after each step of the batch with the number of rows that it stepped.
      most_steps: after so many, episodes are returned without their ends; None for none.

    Raises:
      ValueError: the task cannot run in batches.
      PolicyError: the policy returned no valid action.
    """
    batch = BatchEnvironment.from_environment(environment, len(seeds), num_threads)
    with contextlib.closing(batch):
        running = np.arange(len(seeds))
        time_step = batch.reset(seeds=list(seeds))
        actor.begin(batch.task.action_spec(batch.single), running, seeds)
        most = math.ceil(batch.step_limit)
        steps = _Steps(batch, kept, time_step.observation, min(most, most_steps or most))
        while running.size and not steps.are_full:
            actions = actor.act(time_step.observation, running)
            time_step = batch.step(actions)
            steps.add(running, actions, time_step)
            if on_steps is not None:
                on_steps(len(running))
            running = running[time_step.step_type[running] != _LAST]
        return [steps.episode(row, seed) for row, seed in enumerate(seeds)]


class _Steps:
    """Arrays of all rows and steps, of which an episode is a view."""

    def __init__(
        self,
        batch: BatchEnvironment,
        kept: Kept,
        observation: Mapping[str, np.ndarray],
        most: int,
    ) -> None:
        """Keeps the starts of a batch that was reset, and makes room for so many steps."""
        self._batch = batch
        self._kept = kept
        rows = batch.num_envs
        first = self._in_form(observation)
        self._observations = {
            name: np.empty((rows, most + 1, *value.shape[1:]), kept.observed_type(value.dtype))
            for name, value in first.items()
        }
        shape = batch.action_spec().shape[1:]
        self._actions = np.empty((rows, most, *shape))
        self._rewards = np.empty((rows, most))
        self._terminated, self._truncated, self._success = np.zeros((3, rows, most), bool)
        self._diverged = np.zeros(rows, bool)
        self._lengths = np.zeros(rows, int)
        saved = batch.snapshot().physics
        self._fields = {name: saved[name] for name in getattr(batch.task, "EPISODE_FIELDS", ())}
        self._states: np.ndarray | None = None
        if kept.states:
            self._states = np.empty((rows, most + 1, *saved["state"].shape[1:]))
        self._step = 0
        self._observe(np.arange(rows), first)

    @property
    def are_full(self) -> bool:
        """Whether there is no room for another step."""
        return self._step == self._actions.shape[1]

    def add(self, running: np.ndarray, actions: np.ndarray, time_step: dm_env.TimeStep) -> None:
        """Keeps a step of the rows that are running."""
        batch, step = self._batch, self._step
        self._actions[running, step] = actions[running]
        self._rewards[running, step] = time_step.reward[running]
        last, truncated = time_step.step_type == _LAST, batch.timed_out
        self._truncated[running, step] = (last & truncated)[running]
        self._terminated[running, step] = (last & ~truncated)[running]
        self._diverged[running] = batch.diverged[running]
        if self._has_goal and batch.reward_terms:
            reached = batch.task.is_success(batch.reward_terms) & ~batch.diverged
            self._success[running, step] = reached[running]
        self._step += 1
        self._lengths[running] = self._step
        self._observe(running, self._in_form(time_step.observation))

    def episode(self, row: int, seed: int) -> Episode:
        """The episode of a row, which has ended."""
        length = self._lengths[row]
        return Episode(
            seed,
            None,
            {name: values[row, : length + 1] for name, values in self._observations.items()},
            self._actions[row, :length],
            self._rewards[row, :length],
            self._terminated[row, :length],
            self._truncated[row, :length],
            self._success[row, :length] if self._has_goal else None,
            bool(self._diverged[row]),
            None if self._states is None else self._states[row, : length + 1],
            {name: values[row] for name, values in self._fields.items()},
        )

    def _observe(self, rows: np.ndarray, observation: Mapping[str, np.ndarray]) -> None:
        for name, values in observation.items():
            self._observations[name][rows, self._step] = values[rows]
        if self._states is not None:
            self._states[rows, self._step] = self._batch.physics.get_state(STATE)[rows]

    def _in_form(self, observation: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """A batch's observation, joined into one array where that is wanted."""
        if not self._kept.flat:
            return observation
        return of_rows(observation, self._batch.num_envs, flat=True)

    @property
    def _has_goal(self) -> bool:
        return bool(getattr(self._batch.task, "GOAL", ()))


class Recorded:
    """Acts as recorded episodes did; with zeros after their ends."""

    def __init__(self, actions: Mapping[int, np.ndarray]) -> None:
        """Takes the actions of each seed, (T, ...)."""
        self._of_seeds = actions
        self._of_rows: dict[int, np.ndarray] = {}
        self._step = 0

    def begin(self, spec: specs.BoundedArray, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """See `Actor`; all rows begin together."""
        self._shape, self._step = spec.shape, 0
        self._of_rows = dict(zip(rows.tolist(), (self._of_seeds[s] for s in seeds), strict=True))

    def act(self, observation: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
        """See `Actor`."""
        actions = np.zeros((len(next(iter(observation.values()))), *self._shape))
        for row in rows.tolist():
            recorded = self._of_rows[row]
            if self._step < len(recorded):
                actions[row] = recorded[self._step]
        self._step += 1
        return actions


def actions_of(
    environment: Environment, policy: Policy, seed: int, on_steps: _OnSteps | None = None
) -> np.ndarray:
    """The actions of a policy that plays one episode at a time, (T, ...).

    Args:
      environment: is reseeded and stepped.
      policy: plays the first episode of the seed.
      seed: of the episode.
      on_steps: called with 1 after each step.
    """
    actions: list[np.ndarray] = []

    def begin_in(environment: Environment, seed: int) -> Act:
        act = begin(policy, environment, seed)

        def acting(observation: Mapping[str, np.ndarray]) -> np.ndarray:
            actions.append(np.array(act(observation), float))
            if on_steps is not None:
                on_steps(1)
            return actions[-1].copy()

        return acting

    environment.reseed(seed)
    # A simulation that diverges does so again in the batch, which records it.
    with contextlib.suppress(PhysicsError):
        run_episode(environment, EnvironmentPolicy(begin_in), seed)
    return np.array(actions)
