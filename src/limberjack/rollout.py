"""Runs episodes of an environment with a policy and keeps their rewards.

    environment = suite.load("humanoid", "walk", task_kwargs={"random": seed})
    episode = run_episode(environment, policies.random, seed)
    print(episode.total, episode.length)

It takes one environment at a time and keeps no observations.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from limberjack.policies import Policy, begin

__all__ = ["Episode", "run_episode"]


@dataclasses.dataclass(frozen=True)
class Episode:
    """An episode that has ended."""

    seed: int
    start: str | None  # the kind of start, where the task has kinds
    rewards: np.ndarray  # (T,), one per step

    @property
    def returns(self) -> np.ndarray:
        """The rewards summed up to each step, (T,), added in order as a loop would."""
        return np.cumsum(self.rewards)

    @property
    def total(self) -> float:
        """The episode's return: the sum of its rewards."""
        return float(self.returns[-1]) if self.length else 0.0

    @property
    def length(self) -> int:
        """The number of steps."""
        return len(self.rewards)


def run_episode(
    environment: Any,
    policy: Policy,
    seed: int,
    on_step: Callable[[int, float], object] | None = None,
) -> Episode:
    """The next episode of a `control.Environment`, from its reset to its last step.

    Args:
      environment: it is reset, but not closed.
      policy: begun anew, with `seed`.
      seed: what the environment was seeded with.
      on_step: called with the number of steps so far and the return so far: once after the reset
        and once after each step.
    """
    time_step = environment.reset()
    start = getattr(environment.task, "start", _one_kind_of_start)(environment.physics)
    act = begin(policy, environment, seed)
    rewards: list[float] = []
    total = 0.0
    if on_step is not None:
        on_step(0, total)
    while not time_step.last():
        time_step = environment.step(act(time_step.observation))
        rewards.append(float(time_step.reward))
        total += rewards[-1]
        if on_step is not None:
            on_step(len(rewards), total)
    return Episode(seed, start, np.array(rewards))


def _one_kind_of_start(physics: Any) -> None:
    """The start of tasks that are not made of `suite.base.Task`."""
