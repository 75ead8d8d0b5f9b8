"""Policies by name: zero, random, the planner, or a callable of the user's own.

    policy = policies.find("random")
    act = policies.begin(policy, environment, seed)  # at the start of each episode
    action = act(time_step.observation)

MODULE:CALLABLE names a function from an observation (an `OrderedDict` of arrays) to an action, or
an object with `act(observation)` and, if it wants to know of each episode's start, `reset()`. A
class is called once, without arguments, to make that object.

A policy sees the observation only. The planner is the exception: it plans from the state of the
environment itself, and is an `EnvironmentPolicy`.

It does not train or load anything: what a policy needs, its own module loads.
"""

import dataclasses
import importlib
import inspect
import itertools
from collections.abc import Callable, Mapping
from types import ModuleType

import numpy as np
from dm_env import specs

from limberjack.rl.action_specs import bounded_spec
from limberjack.rl.control import Environment
from limberjack.utils.sources import defined_in
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "Act",
    "EnvironmentPolicy",
    "Policy",
    "PolicyError",
    "begin",
    "find",
    "name_of",
    "planner",
    "planner_with",
    "random",
    "zero",
]

Act = Callable[[Mapping[str, np.ndarray]], np.ndarray]
# Begins an episode: takes the spec of actions and the episode's seed.
Policy = Callable[[specs.BoundedArray, int], Act]


@dataclasses.dataclass(frozen=True)
class EnvironmentPolicy:
    """A policy that needs the environment it acts in, not only what that shows.

    Attributes:
      begin_in: begins an episode: takes the environment, which has been reset and is only to be
        read, and the episode's seed.
    """

    begin_in: Callable[[Environment, int], Act]

    def __call__(self, spec: specs.BoundedArray, seed: int) -> Act:
        """Refuses: a spec of actions is not enough.

        Raises:
          PolicyError: always.
        """
        raise PolicyError(
            "this policy needs the environment, not only the spec of its actions: begin it with "
            "policies.begin(policy, environment, seed)"
        )


# Keeps the actions' stream apart from the start's, which RandomState(seed) draws.
_ACTION_STREAM = 1


class PolicyError(ValueError):
    """A policy cannot be found, or returned what is no action."""


def zero(spec: specs.BoundedArray, seed: int) -> Act:
    """Acts with zero, or with the bound nearest to zero where the bounds exclude it."""
    action = np.clip(np.zeros(spec.shape), spec.minimum, spec.maximum)
    return lambda observation: action.copy()


def random(spec: specs.BoundedArray, seed: int) -> Act:
    """Acts uniformly within the bounds, from a stream of the seed's own."""
    stream = np.random.RandomState([seed, _ACTION_STREAM])
    return lambda observation: stream.uniform(spec.minimum, spec.maximum, spec.shape)


def planner_with(num_threads: int | None) -> EnvironmentPolicy:
    """The planner, which plans from the environment's full state; see `limberjack.planner`.

    Args:
      num_threads: that it simulates with; None for all usable cores.
    """

    def begin_in(environment: Environment, seed: int) -> Act:
        # Imported here: who does not plan need not wait for it.
        from limberjack.planner import Planner

        try:
            chosen = Planner(environment, num_threads, seed)
        except (TypeError, ValueError) as error:
            raise PolicyError(f"policy 'planner': {error}") from error
        return lambda observation: chosen.act()

    return EnvironmentPolicy(begin_in)


planner = planner_with(None)

_BUILT_IN: dict[str, Policy] = {"zero": zero, "random": random, "planner": planner}


def begin(policy: Policy, environment: Environment, seed: int) -> Act:
    """Begins an episode of a policy of either kind, in an environment that has been reset.

    Raises:
      PolicyError: 'zero' or 'random' cannot act by the task's action spec.
    """
    if isinstance(policy, EnvironmentPolicy):
        return policy.begin_in(environment, seed)
    if policy in (zero, random):  # the others act as they know the task
        try:
            bounded_spec(environment.task, environment.physics)
        except (TypeError, ValueError) as error:
            raise PolicyError(f"policy {policy.__name__!r}: {error}") from error
    return policy(environment.action_spec(), seed)


def find(policy: object) -> Policy:
    """A policy by its name, or of what a name may stand for.

    Args:
      policy: 'zero', 'random', 'planner' or 'MODULE:CALLABLE'; or the function, object or class
        that MODULE:CALLABLE might name.

    Raises:
      PolicyError: there is none of that name, or it cannot be called.
    """
    if isinstance(policy, str):
        if policy in _BUILT_IN:
            return _BUILT_IN[policy]
        return _of_target(policy, _named(policy))
    name = name_of(policy)
    return _of_target(name, _make(name, policy) if inspect.isclass(policy) else policy)


def name_of(target: object) -> str:
    """MODULE:CALLABLE of a function or class, or of an object's class."""
    named = defined_in(target)
    return f"{named.__module__}:{named.__qualname__}"


def _of_target(name: str, target: object) -> Policy:
    act = getattr(target, "act", target)
    if not callable(act):
        raise PolicyError(
            f"policy {name!r} is of type {type(target).__name__}; expected a function of an "
            "observation, or an object with act(observation)"
        )
    return _user_policy(name, act, getattr(target, "reset", None))


def _named(name: str) -> object:
    """What MODULE:CALLABLE names; an object of it if it is a class.

    Raises:
      PolicyError: there is none of that name, or the class needs arguments.
    """
    module_name, colon, path = name.partition(":")
    if not (module_name and colon and path):
        raise PolicyError(
            f"policy {name!r} is none of zero, random, planner and MODULE:CALLABLE."
            f"{did_you_mean(name, _BUILT_IN)}"
        )
    target = _find_attribute(name, _import_module(name, module_name), path)
    return _make(name, target) if inspect.isclass(target) else target


def _import_module(name: str, module_name: str) -> ModuleType:
    try:
        return importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if module_name == missing or module_name.startswith(f"{missing}."):
            raise PolicyError(
                f"policy {name!r}: there is no module {missing!r}; run from the directory that "
                "holds it, or install it"
            ) from None
        raise PolicyError(
            f"policy {name!r}: module {module_name!r} needs {missing!r}, which is not installed"
        ) from error
    except (TypeError, ValueError) as error:  # importlib's answers to '.name' and '..'
        if module_name.startswith("."):
            raise PolicyError(
                f"policy {name!r}: module {module_name!r} is relative; name it from the top"
            ) from error
        raise


def _find_attribute(name: str, module: ModuleType, path: str) -> object:
    target: object = module
    for part in path.split("."):
        try:
            target = getattr(target, part)
        except AttributeError:
            public = [choice for choice in dir(target) if not choice.startswith("_")]
            raise PolicyError(
                f"policy {name!r}: {module.__name__!r} has no {path!r}.{did_you_mean(part, public)}"
            ) from None
    return target


def _make(name: str, kind: type) -> object:
    """An object of the class, which must need no arguments."""
    try:
        inspect.signature(kind).bind()
    except TypeError as error:
        raise PolicyError(
            f"policy {name!r} is a class that needs arguments ({error}); name a function, an "
            "object, or a class that needs none"
        ) from error
    except ValueError:  # a class without a readable signature: calling it will tell
        pass
    return kind()


def _user_policy(
    name: str, act: Callable[[Mapping[str, np.ndarray]], object], reset: Callable[[], object] | None
) -> Policy:
    def begin(spec: specs.BoundedArray, seed: int) -> Act:
        if reset is not None:
            reset()
        steps = itertools.count()

        def checked(observation: Mapping[str, np.ndarray]) -> np.ndarray:
            where = f"policy {name!r}, step {next(steps)} of the episode with seed {seed}"
            try:
                returned = act(observation)
            except Exception as error:
                error.add_note(where)
                raise
            return _checked_action(where, returned, spec)

        return checked

    return begin


def _checked_action(where: str, returned: object, spec: specs.BoundedArray) -> np.ndarray:
    """What a policy returned as an array, or `PolicyError` if it is no action of the spec."""
    try:
        action = np.asarray(returned)
    except (TypeError, ValueError, RuntimeError) as error:  # ragged lists, tensors with gradients
        raise PolicyError(f"{where}: returned what is no array of numbers: {error}") from error
    if action.dtype.kind not in "iuf":
        raise PolicyError(
            f"{where}: returned {type(returned).__name__} of dtype {action.dtype}; expected "
            f"numbers of shape {spec.shape}"
        )
    if action.shape != spec.shape:
        raise PolicyError(
            f"{where}: returned an action of shape {action.shape}; expected {spec.shape}"
        )
    finite = np.isfinite(action)
    if not finite.all():
        bad = np.argwhere(~finite).squeeze(-1).tolist()
        raise PolicyError(
            f"{where}: returned {action[~finite][0]} at index {bad}; expected finite numbers"
        )
    return action
