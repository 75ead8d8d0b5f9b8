"""Entry points of the ids that `limberjack.gym` registers, for `gymnasium.make` and `make_vec`.

They are `gym.load` and `gym.load_vector`, except for the length of episodes, which Gymnasium sets;
see `limberjack.gym.lengths`. The spec of a domain outside the suite has the name of its module,
which is imported where the environment is made.
"""

from typing import Any

from limberjack import registry, suite
from limberjack.gym import arguments, lengths
from limberjack.gym.env import Env, load
from limberjack.gym.vector import VectorEnv, load_vector
from limberjack.rl.copies import difference

__all__ = ["make", "make_vector"]

_Module = str | registry.NotImportable | None


# Any: the arguments of `gym.load`, which checks them.
def make(
    domain: str, task: str, *, module: _Module = None, steps: int | None = None, **kwargs: Any
) -> Env:
    """The environment of an id, whose episodes Gymnasium's `TimeLimit` ends.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      module: the dotted name of the domain's module; None for the suite's own.
      steps: the id's length of episodes, if the domain is not the suite's.
      kwargs: of `gym.load`.

    Raises:
      TypeError: an argument is unknown; the message suggests the nearest name.
      ValueError: the time limit is longer than the id's, or the arguments change the control step.
    """
    arguments.refuse_unknown(kwargs, Env, load)
    if isinstance(module, str):
        suite.require(domain, module)
    env = load(domain, task, **kwargs)
    length = registry.steps(domain, task) if module is None else steps
    if length is None:  # Gymnasium adds no TimeLimit
        return env
    environment = env._played
    repeat = environment.action_repeat
    is_asked_for = lengths.asks_for_a_time_limit(kwargs)
    may_repeat = repeat != 1 or difference(env.environment) is not None  # as a wrapper does
    if may_repeat and not is_asked_for and environment.step_limit == length:
        # The id's length is in control steps, of which the last action may have fewer.
        env._length, is_asked_for = length, True
    own = environment._step_limit / repeat
    limit = lengths.limit_of_single(f"{domain}:{task}", length, own, is_asked_for)
    if limit != own:
        environment._step_limit = limit
    env._is_counted_outside = True
    return env


# Read by `gymnasium.make`, which wraps 'rgb_array' for the modes 'human' and 'rgb_array_list'.
make.metadata = Env.metadata  # pyright: ignore[reportFunctionMemberAccess]


def make_vector(
    domain: str,
    task: str,
    num_envs: int,
    *,
    module: _Module = None,
    steps: int | None = None,
    max_episode_steps: int | None = None,
    **kwargs: Any,  # of `gym.load_vector`, which checks them
) -> VectorEnv:
    """The vector environment of an id, with episodes of at most `max_episode_steps` steps.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      num_envs: number of rows.
      module: the dotted name of the domain's module; None for the suite's own.
      steps: the id's length of episodes, if the domain is not the suite's.
      max_episode_steps: from Gymnasium: the caller's, or the id's; -1 for no limit.
      kwargs: of `gym.load_vector`.

    Raises:
      TypeError: an argument is unknown; the message suggests the nearest name.
      ValueError: the time limit is longer than `max_episode_steps`, or that is out of range.
    """
    if isinstance(module, str):
        suite.require(domain, module)
    envs = load_vector(domain, task, num_envs, **kwargs)
    length = registry.steps(domain, task) if module is None else steps
    is_asked_for = lengths.asks_for_a_time_limit(kwargs)
    for batch in envs.batches:
        repeat = batch.action_repeat
        if repeat != 1 and max_episode_steps == length and not is_asked_for:
            continue  # the id's length is in control steps, as is the batch's limit
        own = batch.step_limit / repeat
        limit = lengths.limit_of_batch(
            f"{domain}:{task}", length, max_episode_steps, own, is_asked_for
        )
        if limit != own:
            batch.step_limit = limit * repeat
    return envs
