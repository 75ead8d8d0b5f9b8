"""Checks of the environments in which episodes are played.

environment = checked_environment(factory, seeds, is_kept=True)
repeat = checked_repeat(None, environment, actor)
"""

import contextlib
from collections.abc import Sequence

import dm_env

from limberjack.policies import Actor
from limberjack.policies.kinds import Locating, repeat_for
from limberjack.rl.action_specs import spec_of
from limberjack.rl.batches import batch_of
from limberjack.rl.builds import is_reproducible, is_stable, own_repeat
from limberjack.rl.control import Environment
from limberjack.rl.copies import control_of
from limberjack.rl.row_trial import draws_globally
from limberjack.workers.factories import Factory

__all__ = [
    "checked_environment",
    "checked_repeat",
    "inside",
    "seconds_without_a_limit",
    "step_limit_of",
]

_USUAL_STEPS = 1000  # control steps of an episode, of nearly all tasks with a time limit
_IDENTIFYING = 0  # seed of the environment by which results are identified


def checked_environment(
    factory: Factory,
    seeds: Sequence[int],
    *,
    is_kept: bool,
    vectorised: bool | None = None,
    limit: str | None = None,
) -> dm_env.Environment:
    """An environment of the factory, whose episodes end, depend on their seed, and can be kept.

    Args:
      factory: makes it.
      seeds: of the episodes. The environment is that of seed 0, whose model identifies results
        whatever their seeds, in workers too.
      is_kept: whether results are kept, which must name the environment.
      vectorised: True if vectorised batches are asked for.
      limit: how the caller's user sets a time limit, for messages; None as an argument, which an
        environment of the user's own does not take.

    Raises:
      ValueError: they never end, draw from a stream that environments share, have nested
        observations, could belong to another environment, or cannot be vectorised although that
        is asked for.
    """
    if is_kept and not factory.is_known:
        raise ValueError(_why_unknown(factory))
    environment = factory.make(_IDENTIFYING)
    is_own = "environment" in factory.facts  # the user's
    if step_limit_of(environment) is None:
        where = "time_limit where it is made" if is_own else "time_limit (--time-limit SECONDS)"
        raise ValueError(
            f"{factory.title} has no time limit, so an episode might never end: give it a "
            f"{limit or where}"
        )
    if is_own:
        with contextlib.closing(factory.make(seeds[0])) as trial:
            with Locating(f"environment {factory.title!r}"):
                spec = spec_of(trial)
            shared = draws_globally(trial, spec)
            if shared is not None:
                raise ValueError(
                    f"{factory.title} draws from {shared}, so an episode does not depend on its "
                    "seed alone: draw from task.random, which has the seed"
                )
        _check_seeding(factory, environment, seeds)
    if vectorised:
        _check_vectorised(factory)
    return environment


def checked_repeat(action_repeat: int | None, environment: dm_env.Environment, actor: Actor) -> int:
    """Control steps per action in an environment; see `policies.kinds.repeat_for`."""
    return repeat_for(actor, action_repeat, own_repeat(environment))


def _why_unknown(factory: Factory) -> str:
    """The reason why results of a factory cannot be kept, with advice."""
    if "domain" in factory.facts:
        return (
            f"the module of {factory.facts['domain']!r} has no file, so a change of its code would "
            "not be noticed, and its results cannot be kept in a folder: define the domain in a "
            "module of its own"
        )
    return (
        f"{factory.title} cannot be distinguished from other functions of that name, so its "
        "results cannot be kept in a folder: define make(seed) at the top level of a module"
    )


def _check_vectorised(factory: Factory) -> None:
    """Raises ValueError if the task cannot be vectorised."""
    build = factory.build(factory.make(0))
    batch_of(build, 1, 1, vectorised=True, seed=0, action_repeat=1).close()


def _check_seeding(factory: Factory, environment: dm_env.Environment, seeds: Sequence[int]) -> None:
    """Raises ValueError unless a seed gives one episode, and all seeds one length of a step."""
    build = factory.build(environment)
    with Locating(f"environment {factory.title!r}"):  # which raises for observations of other forms
        same = is_reproducible(build, seeds[0])
    if not same:
        raise ValueError(
            f"{factory.title} makes an environment that differs each time it is called with seed "
            f"{seeds[0]}: pass the seed to the task, and let rewards and observations depend on "
            "nothing else; draw from task.random"
        )
    is_stable(build, seeds[0])  # raises for one that ignores its seed
    for seed in seeds[:2]:
        with contextlib.closing(factory.make(seed)) as other:
            pairs = [(step_limit_of(one), _control_timestep(one)) for one in (environment, other)]
        if pairs[0] != pairs[1]:
            raise ValueError(
                f"{factory.title} makes an environment that differs for seed {seed}: its episodes "
                f"have {pairs[1][0]} steps of {pairs[1][1]} s, and those of seed {_IDENTIFYING} "
                f"{pairs[0][0]} of {pairs[0][1]} s; make them the same for all seeds"
            )


def _control_timestep(environment: dm_env.Environment) -> float:
    return inside(environment).control_timestep()


def seconds_without_a_limit(environment: dm_env.Environment) -> float | None:
    """Seconds that a task without a time limit is scored for, 1,000 control steps; else None."""
    if step_limit_of(environment) is not None:
        return None
    return _USUAL_STEPS * _control_timestep(environment)


def step_limit_of(environment: dm_env.Environment) -> int | None:
    """Steps of an episode; None without a limit."""
    return Environment.step_limit.of(inside(environment))


def inside(environment: dm_env.Environment) -> Environment:
    """The `control.Environment` within an environment of any class.

    Raises:
      ValueError: there is none.
    """
    inner = control_of(environment)
    if not isinstance(inner, Environment):
        raise ValueError(
            f"a {type(environment).__name__} has no limberjack.rl.control.Environment inside, "
            "whose model, state and time limit are needed"
        )
    return inner
