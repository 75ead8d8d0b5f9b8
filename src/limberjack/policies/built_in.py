"""The policies that need no code of your own: zero, random, the planner, and the bundled ones.

actor = policies.find("random")
"""

import functools
import hashlib
import inspect
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import dm_env
import numpy as np
from dm_env import specs

from limberjack.policies.actors import Alone, EachRow
from limberjack.policies.kinds import Act, Actor, Policy, PolicyError
from limberjack.policies.networks import PRETRAINED
from limberjack.rl.action_specs import bounds_to_try
from limberjack.rl.batches import vectorisable
from limberjack.utils.sources import hash_of_files

if TYPE_CHECKING:
    from limberjack.planner import Planner

__all__ = ["BUILT_IN", "OF_ACTIONS", "PLANNER", "OnPlan", "of_actions", "planner", "random", "zero"]

PLANNER = "planner"

# Called with the simulated time in seconds, the stage, and the terms of a plan's cost.
OnPlan = Callable[[float, str, Mapping[str, float]], object]

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


OF_ACTIONS: dict[str, Policy] = {"zero": zero, "random": random}
BUILT_IN = (*OF_ACTIONS, PLANNER, PRETRAINED)


def of_actions(name: str) -> Actor:
    """The policy `zero` or `random`, which needs nothing but the spec of the actions."""
    policy = OF_ACTIONS[name]
    sha256 = hashlib.sha256(inspect.getsource(policy).encode()).hexdigest()
    return EachRow(name, sha256, functools.partial(_in_whole_numbers, policy))


def _in_whole_numbers(policy: Policy, spec: specs.BoundedArray, seed: int) -> Act:
    """Begins an episode of a policy, whose actions are whole numbers where the spec's are."""
    if not np.issubdtype(spec.dtype, np.integer):
        return policy(spec, seed)
    end = np.add(spec.maximum, 1.0)  # so that all numbers are as probable
    act = policy(specs.BoundedArray(spec.shape, float, spec.minimum, end), seed)

    def rounded(observation: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.minimum(np.floor(act(observation)), spec.maximum).astype(spec.dtype)

    return rounded


def planner(
    environment: dm_env.Environment | None = None,
    num_threads: int | None = None,
    on_plan: OnPlan | None = None,
    on_begin: "Callable[[Planner], object] | None" = None,
) -> Actor:
    """The planner, which plans from the environment's full state; see `limberjack.planner`.

    Args:
      environment: the one to act in, whose task's sources identify the planner in results; None
        if they are not needed.
      num_threads: number of threads that simulate; None for all usable cores.
      on_plan: called before each step with the simulated time in seconds, the stage, and the terms
        of the plan's cost.
      on_begin: called with the `Planner` of each episode.

    Raises:
      PolicyError: there is no cost for the environment's task.
    """
    sha256 = None
    if environment is not None:
        from limberjack.planner.cost import sources_for

        try:
            sha256 = hash_of_files(sources_for(vectorisable(environment).task))
        except ValueError as error:
            raise PolicyError(f"policy {PLANNER!r}: {error}") from error
        except (OSError, TypeError) as error:  # of a cost that a notebook or `python -c` defines
            raise PolicyError(
                f"policy {PLANNER!r}: the source of the task's cost cannot be read ({error}): "
                "define it in a module"
            ) from error

    def begin_alone(environment: dm_env.Environment, seed: int) -> Act:
        # Imported here, as only this policy needs it.
        from limberjack.planner import Planner

        try:
            plain = vectorisable(environment)
            chosen = Planner(plain, num_threads, seed)
        except (TypeError, ValueError) as error:
            raise PolicyError(f"policy {PLANNER!r}: {error}") from error
        if on_begin is not None:
            on_begin(chosen)

        def act(observation: object) -> np.ndarray:
            action = chosen.act()
            if on_plan is not None:
                on_plan(plain.physics.time(), *chosen.explain())
            return action

        return act

    return Alone(PLANNER, sha256, begin_alone, action_repeat=1)
