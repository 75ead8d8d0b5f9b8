"""Plays the first episode of each of many seeds, in batches on all cores.

    for ended in play(build, EachRow(policies.random), range(1000)):
        for score in ended:
            print(score.seed, score.total)

Each row of a batch plays one seed's episode; a row whose episode has ended takes the next seed.
Seeds that are equal modulo 64 are played one after the other, so that an actor can use `seed % 64`
as a row number. Scores come in lists: one list for all episodes that end with the same step. They
lack the kind of start. Each episode equals `rollout.run_episode` of an environment with that seed,
bit for bit, if the policy's action for a row does not depend on the other rows. Where that would
raise `PhysicsError`, the episode ends and its score has `diverged`.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence

import dm_env
import numpy as np

from limberjack import rollout
from limberjack.evaluation.statistics import Score
from limberjack.policies import Policy
from limberjack.policies.batched import ROWS, Actor
from limberjack.rl.batch_contract import Batch
from limberjack.rl.batches import batch_of
from limberjack.rl.builds import Build, Seeded
from limberjack.rl.contract import PhysicsError
from limberjack.rl.control import Environment
from limberjack.rl.copies import control_of

__all__ = ["play", "play_alone"]

_LAST = int(dm_env.StepType.LAST)
_INITIAL_CAPACITY = 1000  # steps per row whose rewards fit at first: a suite episode

_OnSteps = Callable[[int], object]


def play(
    build: Build | dm_env.Environment,
    actor: Actor,
    seeds: Sequence[int],
    num_threads: int | None = None,
    on_steps: _OnSteps | None = None,
    action_repeat: int = 1,
) -> Iterator[list[Score]]:
    """The scores of each seed's first episode, as the episodes end.

    Args:
      build: makes the environments, or one to copy; the rows are vectorised if that
        changes no number.
      actor: acts in all rows.
      seeds: at least one.
      num_threads: number of threads that step the rows; by default one per usable core.
      on_steps: called after each step of the batch with the number of rows that it stepped.
      action_repeat: control steps per action. Scores count control steps; pixels are those of
        the steps at which the actor acts.

    Raises:
      ValueError, TypeError: the environments cannot be made or do not agree in their specs;
        nothing was played.
    """
    rows = min(ROWS, len(seeds))
    batch = batch_of(build, rows, num_threads, seed=0, action_repeat=1)
    batch.draw_every(action_repeat)
    return _Playing(batch, actor, seeds, action_repeat).episodes(on_steps)


class _Playing:
    """A batch that plays one episode per seed."""

    def __init__(
        self, batch: Batch, actor: Actor, seeds: Sequence[int], action_repeat: int
    ) -> None:
        rows = batch.num_envs
        self._action_repeat = action_repeat
        self._actions = np.zeros(batch.action_spec().shape)
        self._batch = batch
        self._actor = actor
        self._waiting = list(seeds)
        self._running = np.zeros(rows, bool)
        self._seeds = np.zeros(rows, np.int64)
        self._lengths = np.zeros(rows, int)
        self._rewards = np.zeros((rows, _INITIAL_CAPACITY))

    def episodes(self, on_steps: _OnSteps | None) -> Iterator[list[Score]]:
        """Plays all seeds, and closes the batch."""
        with contextlib.closing(self._batch):
            yield from self._episodes(on_steps)

    def _episodes(self, on_steps: _OnSteps | None) -> Iterator[list[Score]]:
        batch = self._batch
        time_step = self._begin()
        while self._running.any():
            assert time_step is not None
            running = np.flatnonzero(self._running)
            time_step = batch.step(self._acted(time_step, running))
            self._record(time_step.reward, running)
            if on_steps is not None:
                on_steps(len(running))
            ended = running[time_step.step_type[running] == _LAST]
            if ended.size:
                yield [self._score(row) for row in ended.tolist()]
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
        time_step = self._batch.reset(taking, seeds=seeds)
        self._actor.begin(self._batch.single_action_spec(), taking, seeds)
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

    def _record(self, reward: np.ndarray, running: np.ndarray) -> None:
        """Records the rewards of a step."""
        if self._lengths.max() == self._rewards.shape[1]:
            self._rewards = np.concatenate([self._rewards, np.zeros_like(self._rewards)], axis=1)
        self._rewards[running, self._lengths[running]] = reward[running]
        self._lengths[running] += 1

    def _score(self, row: int) -> Score:
        seed, length = int(self._seeds[row]), int(self._lengths[row])
        rewards = self._rewards[row, :length]
        if self._batch.diverged[row]:
            return Score.of_divergence(seed, float(np.cumsum(rewards)[-1]), length)
        return Score.of_rewards(seed, rewards)


def play_alone(
    seeded: Seeded,
    policy: Policy,
    seeds: Sequence[int],
    on_steps: _OnSteps | None = None,
    action_repeat: int = 1,
) -> Iterator[list[Score]]:
    """Like `play`, with a policy that can play only one episode at a time.

    Args:
      seeded: an environment, which begins each seed's first episode and is stepped.
      policy: called at the start of each episode.
      seeds: played in this order.
      on_steps: called with 1 after each step.
      action_repeat: control steps per action.
    """
    for seed in seeds:
        seeded.begin(seed)
        environment = seeded.environment
        inner = control_of(environment)
        if isinstance(inner, Environment):
            inner.action_repeat = 1  # the loop repeats actions, and counts control steps
            inner.draw_every(action_repeat)
        so_far = (0, 0.0)

        def on_step(step: rollout.Step) -> None:
            nonlocal so_far
            so_far = step.number, step.total
            if on_steps is not None and step.number:
                on_steps(1)

        try:
            episode = rollout.run_episode(
                environment, policy, seed, on_step, action_repeat=action_repeat
            )
        except PhysicsError:
            # As in a batch: the step that diverges is the last one, and its reward is 0.
            yield [Score.of_divergence(seed, so_far[1], so_far[0] + 1)]
        else:
            yield [Score.of_rewards(seed, episode.rewards)]
