"""Plays the episodes that a store lacks, in this process or with workers, which never write.

Here(store, build, starts, seeds).play(actor)
play_with(workers, store, [setup, setup.with_policy("zero")], seeds, on_progress)
"""

import contextlib
import dataclasses
import math
from collections.abc import Sequence

from limberjack.episodes import units
from limberjack.episodes.playing import Step, batch_for, play
from limberjack.episodes.starts import Starts
from limberjack.episodes.statistics import Score
from limberjack.evaluation.store import Store
from limberjack.policies import Actor
from limberjack.rl.builds import Build
from limberjack.workers import OnProgress, Setup, Unit, Workers, units_of

__all__ = ["Here", "play_unit", "play_with"]


class Here:
    """Plays in this process."""

    def __init__(
        self,
        store: Store,
        build: Build,
        starts: Starts,
        seeds: Sequence[int],
        *,
        step_limit: float = math.inf,
        num_threads: int | None = None,
        action_repeat: int = 1,
        vectorised: bool | None = None,
        on_progress: OnProgress | None = None,
    ) -> None:
        """Takes what the episodes of all policies have in common.

        Args:
          store: holds the finished episodes, and receives the new ones.
          build: makes the environments.
          starts: determines the kinds of starts.
          seeds: one per episode.
          step_limit: of the episodes.
          num_threads: that step a batch; None for all usable cores.
          action_repeat: control steps per action.
          vectorised: see `rl.batch_of`.
          on_progress: called before a policy's first step, and after each step and episode.
        """
        self._store = store
        self._build = build
        self._starts = starts
        self._seeds = seeds
        self._step_limit = step_limit
        self._num_threads = num_threads
        self._action_repeat = action_repeat
        self._vectorised = vectorised
        self._on_progress = on_progress
        self._finished = 0  # episodes, including those of earlier calls
        self._steps = 0  # of unfinished episodes

    def play(self, actor: Actor) -> None:
        """Plays the seeds that the actor has not played yet."""
        known = self._store.scores[actor.name]
        missing = [seed for seed in self._seeds if seed not in known]
        self._finished += len(self._seeds) - len(missing)
        if not missing:
            return

        def on_step(step: Step) -> None:
            self._steps += step.count
            if step.count:
                self._report(actor.name)

        batch = batch_for(
            self._build, actor, len(missing), self._num_threads, vectorised=self._vectorised
        )
        with contextlib.closing(batch):
            watch = None if self._on_progress is None else on_step
            how = {"action_repeat": self._action_repeat, "on_step": watch}
            self._report(actor.name)
            for ended in play(batch, actor, missing, **how):
                scores = [Score.of(episode, self._starts.kind(episode.seed)) for episode in ended]
                processor = self._store.processor
                self._store.add(
                    actor.name, [dataclasses.replace(one, processor=processor) for one in scores]
                )
                for score in scores:
                    self._finished += 1
                    self._steps -= score.length
                    self._report(actor.name)

    def _report(self, policy: str) -> None:
        if self._on_progress is not None:
            self._on_progress(policy, self._finished, self._steps / self._step_limit)


def play_with(
    workers: Workers,
    store: Store,
    setups: Sequence[Setup],
    seeds: Sequence[int],
    on_progress: OnProgress | None,
) -> None:
    """Plays the seeds that the policies of the setups have not played yet.

    Args:
      workers: play them.
      store: holds the finished episodes, and receives the new ones.
      setups: one for each policy.
      seeds: of the episodes.
      on_progress: called before the first unit and after each one.

    Raises:
      WorkError: see `limberjack.workers`; finished episodes are in the store.
      OSError: the store cannot be written.
    """
    waiting: list[Unit] = []
    for setup in setups:
        known = store.scores[setup.identity["policy"]]
        missing = [seed for seed in seeds if seed not in known]
        waiting += [Unit(setup, block) for block in units_of(missing, setup.unit_size)]
    if not waiting:
        return
    finished = len(seeds) * len(setups) - sum(len(unit.seeds) for unit in waiting)
    if on_progress is not None:
        on_progress(waiting[0].setup.identity["policy"], finished, 0.0)
    for unit, scores in workers.results(play_unit, waiting):
        policy = unit.setup.identity["policy"]
        store.add(policy, scores)
        finished += len(scores)
        if on_progress is not None:
            on_progress(policy, finished, 0.0)


def play_unit(setup: Setup, seeds: tuple[int, ...]) -> list[Score]:
    """The scores of the first episodes of these seeds, with their kinds of starts, in a worker."""
    processor = setup.opened().processor if setup.any_processor else None
    return [
        dataclasses.replace(Score.of(episode), processor=processor)
        for episode in units.play_unit(setup, seeds)
    ]
