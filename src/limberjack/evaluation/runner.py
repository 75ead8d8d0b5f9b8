"""Plays the episodes that a store lacks, and adds the kind of start to each score.

runner = Runner(build, 1, 1000, full_length, store, seeds=[0, 1, 2], threads=None)
runner.run(found, on_progress=None)
"""

import dataclasses
import math
from collections.abc import Callable, Iterator

from limberjack.evaluation.episodes import play, play_alone
from limberjack.evaluation.starts import kind_of_first_start
from limberjack.evaluation.statistics import Score
from limberjack.evaluation.store import Store
from limberjack.policies import actors
from limberjack.rl.builds import Build, Seeded

__all__ = ["OnProgress", "Runner"]

# Called with the name of the policy, the number of finished episodes, and how many episodes' worth
# of steps the running ones have played.
OnProgress = Callable[[str, int, float], object]


class Runner:
    """Plays the episodes that are missing in a store."""

    def __init__(
        self,
        build: Build,
        action_repeat: int,
        step_limit: int | None,
        full_length: Seeded,
        store: Store,
        seeds: list[int],
        threads: int | None,
    ) -> None:
        """Takes what makes the environments.

        Args:
          build: makes those that play the episodes.
          action_repeat: control steps per action.
          step_limit: of their episodes.
          full_length: determines the kinds of starts, with the task's own time limit.
          store: holds the finished episodes, and receives the new ones.
          seeds: one per episode.
          threads: number of threads that step a batch; None for all usable cores.
        """
        self._build = build
        self._action_repeat = action_repeat
        self._step_limit = step_limit
        self._full_length = full_length
        self._store = store
        self._seeds = seeds
        self._threads = threads
        by_seed = (score for of_policy in store.scores.values() for score in of_policy.values())
        self._starts = {score.seed: score.start for score in by_seed}
        self._finished = 0  # episodes, including those of earlier calls

    def run(self, found: actors.Found, on_progress: OnProgress | None) -> None:
        """Plays the seeds that the policy has not played yet."""
        known = self._store.scores[found.name]
        missing = [seed for seed in self._seeds if seed not in known]
        limit = self._step_limit or math.inf
        self._finished += len(self._seeds) - len(missing)
        steps = 0  # of unfinished episodes

        def report_progress() -> None:
            if on_progress is not None:
                on_progress(found.name, self._finished, steps / limit)

        def on_steps(count: int) -> None:
            nonlocal steps
            steps += count
            report_progress()

        if not missing:
            return
        playing = self._scores(found, missing, on_steps)  # raises if batches cannot play the task
        report_progress()
        for ended in playing:
            self._store.add(found.name, [self._with_start(score) for score in ended])
            for score in ended:
                self._finished += 1
                steps -= score.length
                report_progress()

    def close(self) -> None:
        """Frees the environment of full length."""
        self._full_length.environment.close()

    def _scores(
        self, found: actors.Found, seeds: list[int], on_steps: Callable[[int], None]
    ) -> Iterator[list[Score]]:
        if found.actor is not None:
            return play(
                self._build, found.actor, seeds, self._threads, on_steps, self._action_repeat
            )
        assert found.alone is not None
        seeded = self._build.seeded(seeds[0])
        return play_alone(seeded, found.alone, seeds, on_steps, self._action_repeat)

    def _with_start(self, score: Score) -> Score:
        """The score with its kind of start, which is determined once per seed."""
        if score.seed not in self._starts:
            self._starts[score.seed] = kind_of_first_start(self._full_length, score.seed)
        start = self._starts[score.seed]
        return dataclasses.replace(score, start=start, processor=self._store.processor)
