"""The types of policies, and the error that they raise.

    policy: Policy = policies.random
    act: Act = policy(environment.action_spec(), seed)  # begins an episode
    action = act(time_step.observation)

An `EnvironmentPolicy` is a policy too, but begins with the environment; `policies.begin` begins
either kind.
"""

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from dm_env import specs

from limberjack.rl.control import Environment

__all__ = ["Act", "EnvironmentPolicy", "Policy", "PolicyError"]

Act = Callable[[Mapping[str, np.ndarray]], np.ndarray]
# Begins an episode: takes the spec of actions and the episode's seed.
Policy = Callable[[specs.BoundedArray, int], Act]


class PolicyError(ValueError):
    """A policy cannot be found or used, or returned something that is not an action."""


@dataclasses.dataclass(frozen=True)
class EnvironmentPolicy:
    """A policy that needs the environment it acts in, not only its observations.

    Attributes:
      begin_in: begins an episode: takes the environment, which has been reset and must only be
        read, and the episode's seed.
    """

    begin_in: Callable[[Environment, int], Act]

    def __call__(self, spec: specs.BoundedArray, seed: int) -> Act:
        """Refuses, because a spec of actions is not enough.

        Raises:
          PolicyError: always.
        """
        raise PolicyError(
            "this policy needs the environment, not only the spec of its actions: begin it with "
            "policies.begin(policy, environment, seed)"
        )
