"""`run_episode`: an episode of a single environment in a plain loop, beside which batches are held.

episode = run_episode(environment, policies.find("random"), seed)
"""

import math
from collections.abc import Callable

import dm_env
import numpy as np

from limberjack.episodes import Episode
from limberjack.policies import Actor, Policy
from limberjack.see.report import Step
from limberjack.suite.base import kind_of_start

__all__ = ["run_episode"]


def run_episode(
    environment: dm_env.Environment,
    policy: Actor | Policy,
    seed: int,
    on_step: Callable[[Step], object] | None = None,
    max_steps: float = math.inf,
) -> Episode:
    """Runs the next episode of an environment, from its reset to its last step."""
    time_step = environment.reset()
    start = kind_of_start(environment)
    if callable(policy):
        act = policy(environment.action_spec(), seed)  # pyright: ignore[reportArgumentType]
    else:
        act = policy.begin_alone(environment, seed)
    rewards: list[float] = []
    total = 0.0
    if on_step is not None:
        on_step(Step(0, total, time_step, None))
    while not time_step.last() and len(rewards) < max_steps:
        action = act(time_step.observation)
        time_step = environment.step(action)
        rewards.append(float(time_step.reward))
        total += rewards[-1]
        if on_step is not None:
            on_step(Step(len(rewards), total, time_step, action))
    return Episode(seed, start, np.array(rewards))
