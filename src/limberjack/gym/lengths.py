"""The length of episodes of environments that Gymnasium makes.

    env = gymnasium.make("limberjack/humanoid-walk-v0", max_episode_steps=200)
    gym.restore(env, snapshot)

`gymnasium.make` wraps a single environment in a `TimeLimit` of `max_episode_steps`, or of the id's
own length, and does not pass the number on. So the inner environment has no limit of its own,
unless `time_limit` sets a shorter one. `make_vec` passes the number to a batch, which counts its
steps itself.
"""

import math
import operator
from collections.abc import Mapping

import gymnasium
from gymnasium.wrappers import TimeLimit

from limberjack.gym.env import Env, check_steps
from limberjack.rl.snapshot import Snapshot, as_snapshot

__all__ = ["UNLIMITED", "asks_for_a_time_limit", "limit_of_batch", "limit_of_single", "restore"]

UNLIMITED = -1  # Gymnasium's `max_episode_steps` for no limit


def asks_for_a_time_limit(kwargs: Mapping[str, object]) -> bool:
    """Whether the arguments of an environment set a time limit."""
    of_task = kwargs.get("task_kwargs")
    beside = isinstance(of_task, Mapping) and of_task.get("time_limit") is not None
    return kwargs.get("time_limit") is not None or beside


def limit_of_single(name: str, length: int, own: float, is_asked_for: bool) -> float:
    """The limit, in steps, of a single environment inside Gymnasium's `TimeLimit`.

    Args:
      name: of the task, for messages.
      length: of the id, in steps, which `TimeLimit` counts unless the caller gives another number.
      own: the environment's limit as it was loaded.
      is_asked_for: whether the caller gave a time limit.

    Raises:
      ValueError: `TimeLimit` would end the episode earlier.
    """
    if is_asked_for:
        if own > length:
            raise ValueError(
                f"time_limit makes episodes of {_steps(own)}, and Gymnasium ends those of {name} "
                f"after {length}: give {_maximum(own)} to gymnasium.make instead"
            )
        return own
    _check_control_step(name, length, own)
    return math.inf


def limit_of_batch(
    name: str, length: int | None, most: int | None, own: float, is_asked_for: bool
) -> float:
    """The limit, in steps, of the rows of a batch that `gymnasium.make_vec` makes.

    Args:
      name: of the task, for messages.
      length: of the id, in steps; None for an id without a length.
      most: `max_episode_steps` as Gymnasium passes it on: the caller's, or the id's.
      own: the batch's limit as it was loaded.
      is_asked_for: whether the caller gave a time limit.

    Raises:
      TypeError: `most` is not a whole number.
      ValueError: `most` is out of range, or less than the time limit.
    """
    if most is None:
        return own
    most = _checked(most)
    if is_asked_for:
        if most != UNLIMITED and own > most:
            raise ValueError(
                f"time_limit makes episodes of {_steps(own)}, and max_episode_steps={most} ends "
                f"those of {name} earlier: give {_maximum(own)} to gymnasium.make_vec instead"
            )
        return own
    if length is not None and most == length:
        _check_control_step(name, length, own)
    return math.inf if most == UNLIMITED else most


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


def _check_control_step(name: str, length: int, own: float) -> None:
    """Raise ValueError if a changed control step gives episodes another length than the id's."""
    if math.isinf(own) or math.ceil(own) != length:
        raise ValueError(
            f"with these arguments episodes of {name} have {_steps(own)}, and Gymnasium ends them "
            f"after {length}: make the environment with limberjack.gym.load or load_vector, which "
            "count by themselves"
        )


def _checked(most: int) -> int:
    try:
        number = operator.index(most)
    except TypeError:
        number = None
    if number is None or isinstance(most, bool):
        raise TypeError(f"max_episode_steps is {most!r}; expected a whole number")
    if number != UNLIMITED and number < 1:
        raise ValueError(
            f"max_episode_steps is {number}; expected at least 1, or {UNLIMITED} for no limit"
        )
    return number


def _steps(limit: float) -> str:
    return f"{math.ceil(limit)} steps" if math.isfinite(limit) else "no limited length"


def _maximum(limit: float) -> str:
    return f"max_episode_steps={math.ceil(limit) if math.isfinite(limit) else UNLIMITED}"
