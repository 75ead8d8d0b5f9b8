"""Entry points of the ids that `limberjack.gym` registers, for `gymnasium.make` and `make_vec`.

    env = gymnasium.make("limberjack/humanoid-walk-v0", max_episode_steps=200)
    restore(env, snapshot)
    spec = spec_of("humanoid", "walk", steps=200, flat=True)
    env = gymnasium.make(spec)          # in any process: Gymnasium imports limberjack for it
    text = spec.to_json()

They are `gym.load` and `gym.load_vector`, except for the length of episodes: `gymnasium.make` wraps
a single environment in a `TimeLimit` of `max_episode_steps`, or of the id's own length, and does
not pass the number on. So the inner environment has no limit of its own, unless `time_limit` sets a
shorter one. `make_vec` passes the number to a batch, which counts its steps itself.

The spec of a domain outside the suite has the name of its module, which is imported where the
environment is made.
"""

import copy
import math
import operator
from collections.abc import Mapping
from typing import Any

import gymnasium
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeLimit

from limberjack import registry, suite
from limberjack.gym import arguments
from limberjack.gym.env import Env, check_steps, load
from limberjack.gym.loading import load_vector
from limberjack.gym.vector import VectorEnv
from limberjack.registry.sets import Tasks
from limberjack.rl.copies import difference
from limberjack.rl.snapshot import Snapshot, as_snapshot

__all__ = ["make", "make_many", "make_vector", "restore", "spec_of"]

_UNLIMITED = -1  # Gymnasium's `max_episode_steps` for no limit


def _asks_for_a_time_limit(kwargs: Mapping[str, object]) -> bool:
    """Whether the arguments of an environment set a time limit."""
    of_task = kwargs.get("task_kwargs")
    beside = isinstance(of_task, Mapping) and of_task.get("time_limit") is not None
    return kwargs.get("time_limit") is not None or beside


def _limit(
    name: str,
    length: int | None,
    most: int | None,
    own: float,
    is_asked_for: bool,
    make: str,
) -> float:
    """The number of actions of an episode of an environment that Gymnasium makes.

    Args:
      name: of the task, for messages.
      length: of the id; None for an id without a length.
      most: the number after which Gymnasium ends episodes: the caller's, or the id's; None for an
        id or a spec without one.
      own: the environment's limit as it was loaded.
      is_asked_for: whether the caller gave a time limit.
      make: Gymnasium's function.

    Raises:
      TypeError: `most` is not a whole number.
      ValueError: `most` is out of range; the time limit is longer than the id's length; or changed
        control steps give episodes another length than the id's.
    """
    if most is None:  # that of a spec without a limit, if the id has one
        return own if length is None or is_asked_for else math.inf
    most = _checked(most)
    if is_asked_for:
        if most == length and own > most:
            raise ValueError(
                f"time_limit makes episodes of {_steps(own)}, and Gymnasium ends those of {name} "
                f"after {most}: give {make} {_maximum(own)} in its place"
            )
        return own if most == _UNLIMITED else min(own, most)
    if most == length and (math.isinf(own) or math.ceil(own) != length):
        raise ValueError(
            f"with these arguments episodes of {name} have {_steps(own)}, and Gymnasium ends them "
            f"after {length}: make the environment with limberjack.gym.load or load_vector, which "
            "count by themselves"
        )
    return math.inf if most == _UNLIMITED else most


def restore(env: gymnasium.Env, snapshot: Snapshot) -> None:
    """Continue from a snapshot in an environment made by `gymnasium.make` or `gym.load`.

    It also sets the count of Gymnasium's `TimeLimit`, which `env.unwrapped.environment.restore`
    cannot reach.

    Raises:
      TypeError: the environment is not of `limberjack.gym`, or it is not a snapshot.
      ValueError: the snapshot does not fit, or is of a step at or after the limit.
    """
    inner = env.unwrapped
    if not isinstance(inner, Env):
        raise TypeError(f"env is {env}; expected an environment of limberjack.gym")
    steps = inner.actions_of(int(as_snapshot(snapshot).step_count[0]))
    limits = _time_limits(env)
    if not snapshot.begins[0]:
        check_steps(steps, limits)
    inner.restore(snapshot)
    for limit in limits:
        limit._elapsed_steps = steps


def _time_limits(env: gymnasium.Env) -> list[TimeLimit]:
    found = []
    while isinstance(env, gymnasium.Wrapper):
        if isinstance(env, TimeLimit):
            found.append(env)
        env = env.env
    return found


def _checked(most: int) -> int:
    try:
        number = operator.index(most)
    except TypeError:
        number = None
    if number is None or isinstance(most, bool):
        raise TypeError(f"max_episode_steps is {most!r}; expected a whole number")
    if number != _UNLIMITED and number < 1:
        raise ValueError(
            f"max_episode_steps is {number}; expected at least 1, or {_UNLIMITED} for no limit"
        )
    return number


def _steps(limit: float) -> str:
    return f"{math.ceil(limit)} steps" if math.isfinite(limit) else "no limited length"


def _maximum(limit: float) -> str:
    return f"max_episode_steps={math.ceil(limit) if math.isfinite(limit) else _UNLIMITED}"


def spec_of(domain: str, task: str, steps: int | None = None, **kwargs: object) -> EnvSpec:
    """The specification of a task's environment.

    Args:
      domain: such as 'humanoid'.
      task: such as 'walk'.
      steps: the length of its episodes; None for the id's own.
      kwargs: of `gym.load`.

    Raises:
      gymnasium.error.Error: there is no such id.
    """
    spec = copy.deepcopy(gymnasium.spec(f"limberjack/{domain}-{task}-v0"))
    spec.kwargs.update(kwargs)
    if steps is not None:
        spec.max_episode_steps = steps
    return spec


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
    is_asked_for = _asks_for_a_time_limit(kwargs)
    may_repeat = repeat != 1 or difference(env.environment) is not None  # as a wrapper does
    if may_repeat and not is_asked_for and environment.step_limit == length:
        # The id's length is in control steps, of which the last action may have fewer.
        env._length, is_asked_for = length, True
    own = environment._step_limit / repeat
    if _asks_for_a_time_limit(kwargs) and math.isfinite(own):
        env._most = math.ceil(own)
    limit = _limit(f"{domain}:{task}", length, length, own, is_asked_for, "gymnasium.make")
    if not is_asked_for:
        limit = math.inf  # `TimeLimit` counts instead
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
      ValueError: the time limit is longer than the id's, or `max_episode_steps` is out of range.
    """
    if isinstance(module, str):
        suite.require(domain, module)
    envs = load_vector(domain, task, num_envs, **kwargs)
    length = registry.steps(domain, task) if module is None else steps
    is_asked_for = _asks_for_a_time_limit(kwargs)
    for batch in envs.batches:
        repeat = batch.action_repeat
        if repeat != 1 and max_episode_steps == length and not is_asked_for:
            continue  # the id's length is in control steps, as is the batch's limit
        own = batch.step_limit / repeat
        name = f"{domain}:{task}"
        how = own, is_asked_for, "gymnasium.make_vec"
        limit = _limit(name, length, max_episode_steps, *how)
        if limit != own:
            batch.step_limit = limit * repeat
    return envs


def make_many(
    num_envs: int,
    *,
    tasks: Tasks,
    max_episode_steps: int | None = None,
    **kwargs: Any,  # of `gym.load_vector`, which checks them
) -> VectorEnv:
    """The vector environment of several tasks, of the id `limberjack/many-v0`.

    Args:
      num_envs: number of rows, a multiple of the number of tasks.
      tasks: a list such as ['cheetah:run', 'walker:walk'], or the name of a set.
      max_episode_steps: actions of the episodes of all tasks; -1 for no limit, None for the tasks'
        own.
      kwargs: of `gym.load_vector`.

    Raises:
      TypeError: an argument is unknown; the message suggests the nearest name.
      ValueError: see `gym.load_vector`; or `max_episode_steps` is out of range.
    """
    most = None if max_episode_steps is None else _checked(max_episode_steps)
    # Gymnasium's own default is one row.
    count = None if num_envs == 1 and kwargs.get("rows") is not None else num_envs
    envs = load_vector(tasks, num_envs=count, **kwargs)
    for batch in envs.batches:
        if most is not None:
            batch.step_limit = math.inf if most == _UNLIMITED else most * batch.action_repeat
    return envs
