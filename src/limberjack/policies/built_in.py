"""The policies that need no code of your own: zero, random and the planner.

    act = begin(random, environment, seed)

`begin` begins an episode of any policy, built in or not.
"""

from typing import cast

import dm_env
import numpy as np
from dm_env import specs

from limberjack.policies.kinds import Act, EnvironmentPolicy, Policy, PolicyError
from limberjack.rl.action_specs import bounds_to_try, spec_of
from limberjack.rl.batches import vectorisable
from limberjack.rl.control import Environment

__all__ = ["BUILT_IN", "begin", "planner", "planner_with", "random", "zero"]

# Keeps the actions' stream apart from the start's, which RandomState(seed) draws.
_ACTION_STREAM = 1


# Results name the policies `zero` and `random` by the hash of the text of these two functions.
def zero(spec: specs.BoundedArray, seed: int) -> Act:
    """Acts with zero, or with the bound nearest to zero where the bounds exclude it."""
    action = np.clip(np.zeros(spec.shape), spec.minimum, spec.maximum)
    return lambda observation: action.copy()


def random(spec: specs.BoundedArray, seed: int) -> Act:
    """Acts uniformly within the bounds, or within -1 and 1 where there are none."""
    stream = np.random.RandomState([seed, _ACTION_STREAM])  # of its own
    low, high = bounds_to_try(spec)
    return lambda observation: stream.uniform(low, high, spec.shape)


def planner_with(num_threads: int | None) -> EnvironmentPolicy:
    """The planner, which plans from the environment's full state; see `limberjack.planner`.

    Args:
      num_threads: number of threads that simulate; None for all usable cores.
    """

    def begin_in(environment: dm_env.Environment, seed: int) -> Act:
        # Imported here, as only this policy needs it.
        from limberjack.planner import Planner

        try:
            plain = vectorisable(environment)
            if plain.action_repeat != 1:
                raise ValueError(
                    f"the environment has action_repeat={plain.action_repeat}, but it acts at "
                    "every control step: leave action_repeat at 1"
                )
            chosen = Planner(plain, num_threads, seed)
        except (TypeError, ValueError) as error:
            raise PolicyError(f"policy 'planner': {error}") from error
        return lambda observation: chosen.act()

    return EnvironmentPolicy(begin_in)


planner = planner_with(None)

BUILT_IN: dict[str, Policy] = {"zero": zero, "random": random, "planner": planner}


def begin(policy: Policy, environment: dm_env.Environment, seed: int) -> Act:
    """Begins an episode of a policy of either kind, in an environment that has been reset.

    Raises:
      PolicyError: the policy cannot act in this environment.
    """
    if isinstance(policy, EnvironmentPolicy):
        # One that needs a `control.Environment` checks that it is one.
        return policy.begin_in(cast(Environment, environment), seed)
    if policy in (zero, random):  # others know the task's actions themselves
        try:
            spec_of(environment)
        except (TypeError, ValueError) as error:
            raise PolicyError(f"policy {policy.__name__!r}: {error}") from error
    return policy(cast(specs.BoundedArray, environment.action_spec()), seed)
