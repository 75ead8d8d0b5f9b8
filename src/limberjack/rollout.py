"""Run episodes of an environment with a policy and keep their rewards.

    environment = suite.load("humanoid", "walk", task_kwargs={"random": seed})
    episode = run_episode(environment, policies.random, seed)
    print(episode.total, episode.length)

All of the project that steps one environment uses this loop, and observes it through `on_step`.
Batches have loops of their own. Observations are not kept.
"""

import dataclasses
from collections.abc import Callable

import dm_env
import numpy as np

from limberjack.policies import Policy, begin
from limberjack.rl.copies import control_of
from limberjack.utils.seeds import checked_seed

__all__ = ["Episode", "OnStep", "Step", "kind_of_start", "run_episode"]


@dataclasses.dataclass(frozen=True)
class Step:
    """The reset of an episode or one of its steps."""

    number: int  # steps so far; 0 for the reset
    total: float  # return so far
    time_step: dm_env.TimeStep
    action: np.ndarray | None  # the action of this step; None for the reset

    @property
    def reward(self) -> float:
        """The reward of this step; 0 for the reset."""
        return 0.0 if self.time_step.reward is None else float(self.time_step.reward)


OnStep = Callable[[Step], object]


@dataclasses.dataclass(frozen=True)
class Episode:
    """An episode that has ended."""

    seed: int
    start: str | None  # kind of start; None if the task has no kinds
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
    environment: dm_env.Environment,
    policy: Policy,
    seed: int,
    on_step: OnStep | None = None,
    max_steps: float = float("inf"),
    action_repeat: int = 1,
) -> Episode:
    """Runs the next episode of an environment, from its reset to its last step.

    Args:
      environment: it is reset, but not closed.
      policy: begun after the reset, with `seed`.
      seed: the seed of the environment.
      on_step: called once after the reset and once after each step.
      max_steps: the most steps to run; by default the episode runs to its end.
      action_repeat: control steps per action of the policy; steps are control steps.

    Raises:
      TypeError, ValueError: the seed is not a seed; nothing was run.
    """
    seed = checked_seed(seed)
    time_step = environment.reset()
    start = kind_of_start(environment)
    act = begin(policy, environment, seed)
    rewards: list[float] = []
    total, action = 0.0, None
    if on_step is not None:
        on_step(Step(0, total, time_step, None))
    while not time_step.last() and len(rewards) < max_steps:
        if len(rewards) % action_repeat == 0:
            action = act(time_step.observation)
        time_step = environment.step(action)
        rewards.append(float(time_step.reward))
        total += rewards[-1]
        if on_step is not None:
            on_step(Step(len(rewards), total, time_step, action))
    return Episode(seed, start, np.array(rewards))


def kind_of_start(environment: dm_env.Environment) -> str | None:
    """The kind of start of an episode that has just begun; None for a task without kinds."""
    inner = control_of(environment)
    # Only `suite.base.Task` promises the attribute.
    start = getattr(getattr(inner, "task", None), "start", None)
    return None if start is None else start(getattr(inner, "physics", None))
