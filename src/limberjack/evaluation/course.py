"""Plays the episodes that a store lacks, each with the kind of its start.

course = Course(environment, falls, store, seeds=[0, 1, 2], threads=None)
course.run(found, on_progress=None)
"""

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from limberjack import report
from limberjack.evaluation import actors
from limberjack.evaluation.episodes import play, play_alone
from limberjack.evaluation.starts import kind_of_start
from limberjack.evaluation.statistics import Score
from limberjack.evaluation.store import Store
from limberjack.factories import Factory
from limberjack.rl.control import Environment

__all__ = ["Course", "OnProgress", "check_seeding"]

# Called with the policy that plays, the episodes finished, and the part played of running ones.
OnProgress = Callable[[str, int, float], object]


class Course:
    """Plays what is missing in a store."""

    def __init__(
        self,
        environment: Environment,
        falls: Environment,
        store: Store,
        seeds: list[int],
        threads: int | None,
    ) -> None:
        """Takes over two environments of the task; that of `falls` has no short time limit."""
        self._environment = environment
        self._falls = falls
        self._store = store
        self._seeds = seeds
        self._threads = threads
        by_seed = (score for of_policy in store.scores.values() for score in of_policy.values())
        self._starts = {score.seed: score.start for score in by_seed}
        self._finished = 0  # episodes, those of earlier calls included

    def run(self, found: actors.Found, on_progress: OnProgress | None) -> None:
        """Plays the seeds that the policy has not played."""
        known = self._store.scores[found.name]
        missing = [seed for seed in self._seeds if seed not in known]
        limit = self._environment.step_limit or math.inf
        self._finished += len(self._seeds) - len(missing)
        steps = 0  # of episodes that go on

        def tell() -> None:
            if on_progress is not None:
                on_progress(found.name, self._finished, steps / limit)

        def on_steps(count: int) -> None:
            nonlocal steps
            steps += count
            tell()

        if not missing:
            return
        playing = self._scores(found, missing, on_steps)  # raises if it cannot be in a batch
        tell()
        for ended in playing:
            self._store.add(found.name, [self._with_start(score) for score in ended])
            for score in ended:
                self._finished += 1
                steps -= score.length
                tell()

    def close(self) -> None:
        """Frees the environments."""
        self._environment.close()
        self._falls.close()

    def _scores(
        self, found: actors.Found, seeds: list[int], on_steps: Callable[[int], None]
    ) -> Iterator[list[Score]]:
        if found.actor is not None:
            return play(self._environment, found.actor, seeds, self._threads, on_steps)
        assert found.alone is not None
        return play_alone(self._environment, found.alone, seeds, on_steps)

    def _with_start(self, score: Score) -> Score:
        """The score with the kind of its start, which is found once for each seed."""
        if score.seed not in self._starts:
            self._starts[score.seed] = kind_of_start(self._falls, score.seed)
        return dataclasses.replace(score, start=self._starts[score.seed])


def check_seeding(factory: Factory, environment: Environment, seeds: Sequence[int]) -> None:
    """Compare environments that a factory makes with one that is seeded again instead.

    An evaluation makes one environment and seeds it for each episode.

    Raises:
      ValueError: they do not begin the same episode, or differ in the length of episodes or steps.
    """
    for seed in seeds:
        made = factory.make(seed)
        environment.reseed(seed)
        if _beginning(made) != _beginning(environment):
            raise ValueError(
                f"{factory.title} with seed {seed} makes another environment than reseed({seed}) "
                "of the one that it made before: what depends on the seed must be drawn from "
                "task.random in initialize_episode, and the rest be the same for all seeds"
            )
        made.close()


def _beginning(environment: Environment) -> tuple[object, ...]:
    """What an episode of the environment depends on, once it has begun."""
    observation = environment.reset().observation
    return (
        environment.step_limit,
        environment.control_timestep(),
        report.fingerprint(environment.physics.model._model),
        environment.physics.get_state().tobytes(),
        {name: np.asarray(value).tobytes() for name, value in observation.items()},
    )
