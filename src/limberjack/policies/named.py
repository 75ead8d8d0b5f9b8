"""MODULE:CALLABLE: functions, objects and classes of your own as policies.

    target = target_named("my_policies:Still")  # an object of the class
    actor = actor_of("my_policies:Still", sha256, target)

What they return is checked at every step; an error names the policy, the step and the seed.
"""

import copy
import importlib
import inspect
import itertools
from collections.abc import Callable, Mapping
from types import ModuleType

import numpy as np
from dm_env import specs

from limberjack.policies.actors import (
    ActBatch,
    Alone,
    Batched,
    EachRow,
    ResetBatch,
    as_numbers,
    check_numbers,
)
from limberjack.policies.built_in import BUILT_IN
from limberjack.policies.kinds import Act, Actor, Locating, Policy, PolicyError
from limberjack.rl.action_specs import spec_of
from limberjack.utils.log import log
from limberjack.utils.sources import defined_in
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "NOT_RESET",
    "actor_of",
    "copied",
    "found_named",
    "instance_of",
    "is_stateful_object",
    "name_of",
    "target_named",
]

# Logged; commands print it.
NOT_RESET = (
    "policy %r sets its attribute %r as it acts, and has no reset(): episodes that are played "
    "together share it. Define reset(), which is called before each episode"
)


def name_of(target: object) -> str:
    """MODULE:CALLABLE of a function or class, or of an object's class."""
    named = defined_in(target)
    return f"{named.__module__}:{named.__qualname__}"


def target_named(name: str) -> object:
    """The function or object that MODULE:CALLABLE names; of a class, a new object.

    Raises:
      PolicyError: there is nothing of that name, or the class needs arguments.
    """
    target = _found(name)
    return instance_of(name, target) if inspect.isclass(target) else target


def is_stateful_object(policy: object) -> bool:
    """Whether a policy, or what MODULE:CALLABLE names, is one object with the state of episodes.

    A class is not: each use of it has an object of its own.

    Raises:
      PolicyError: there is nothing of that name.
    """
    target = _found(policy) if isinstance(policy, str) and policy not in BUILT_IN else policy
    if inspect.isclass(target):
        return False
    return hasattr(target, "reset") or hasattr(target, "reset_batch")


def instance_of(name: str, kind: type) -> object:
    """An object of a class, which must need no arguments.

    Raises:
      PolicyError: it needs arguments.
    """
    try:
        inspect.signature(kind).bind()
    except TypeError as error:
        raise PolicyError(
            f"policy {name!r} is a class that needs arguments ({error}); name a function, an "
            "object, or a class that needs none"
        ) from error
    except ValueError:  # a class without a readable signature: the call below will raise
        pass
    with Locating(f"policy {name!r}, as its object is made"):
        return kind()


def actor_of(name: str, sha256: str | None, target: object) -> Actor:
    """The actor that a function or an object is.

    Args:
      name: of the policy.
      sha256: of its source; None if that is not known.
      target: a function of an observation, or an object with `act` or `act_batch`.

    Raises:
      PolicyError: it is something else.
    """
    functions = _batch_functions(name, target)
    if functions is not None:
        return Batched(name, sha256, *functions)
    act = getattr(target, "act", target)
    if not callable(act):
        raise PolicyError(
            f"policy {name!r} is of type {type(target).__name__}; expected a function of an "
            "observation, or an object with act(observation) or act_batch(observations)"
        )
    reset = getattr(target, "reset", None)
    if reset is None:
        return EachRow(name, sha256, _checking_policy(name, _watching(name, target, act), None))
    begin = _checking_policy(name, act, reset)
    return Alone(name, sha256, lambda environment, seed: begin(spec_of(environment), seed))


def copied(name: str, target: object) -> object:
    """A copy of an object with the state of episodes; any other target itself.

    Raises:
      PolicyError: it cannot be copied.
    """
    if not is_stateful_object(name):
        return target
    try:
        return copy.deepcopy(target)
    except Exception as error:  # of any class: it is the user's object
        raise PolicyError(
            f"policy {name!r} is an object that cannot be copied ({error}), and threads would "
            "share its state: name its class, or give each worker one thread in its own process"
        ) from error


def _batch_functions(name: str, target: object) -> tuple[ActBatch, ResetBatch | None] | None:
    """The functions `act_batch` and `reset_batch` of an object; None if it acts on one row.

    Raises:
      PolicyError: it has `reset` in the place of `reset_batch`.
    """
    act_batch = getattr(target, "act_batch", None)
    if act_batch is None:
        return None
    reset_batch = getattr(target, "reset_batch", None)
    if reset_batch is None and getattr(target, "reset", None) is not None:
        raise PolicyError(
            f"policy {name!r} has act_batch and reset, which a batch never calls: write "
            "reset_batch(rows, seeds), called where episodes begin in some of the rows"
        )
    return act_batch, reset_batch


def _found(name: str) -> object:
    """The function, object or class that MODULE:CALLABLE names."""
    if not _is_dotted(name):
        raise PolicyError(
            f"policy is {name!r}; expected {', '.join(BUILT_IN)}, mlp:PATH, onnx:PATH, sb3:PATH or "
            f"MODULE:CALLABLE.{did_you_mean(name, BUILT_IN)}"
        )
    return found_named(f"policy {name!r}", name)


def found_named(what: str, name: str) -> object:
    """The object that MODULE:NAME names.

    Args:
      what: the object, for messages.
      name: its name.

    Raises:
      PolicyError: there is none.
    """
    if not _is_dotted(name):
        raise PolicyError(f"{what} is {name!r}; expected MODULE:NAME, such as my_package:make")
    module_name, _, path = name.partition(":")
    return _find_attribute(what, _import_module(what, module_name), path)


def _is_dotted(name: str) -> bool:
    module_name, colon, path = name.partition(":")
    return bool(module_name and colon and path)


def _import_module(what: str, module_name: str) -> ModuleType:
    try:
        with Locating(f"{what}, as its module is imported"):
            return importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        missing = error.name or ""
        if module_name.endswith(".py"):
            full = module_name.removesuffix(".py").replace("/", ".")
            raise PolicyError(
                f"{what}: {module_name!r} is a file; expected the name of its module, {full!r}"
            ) from None
        if module_name == missing or module_name.startswith(f"{missing}."):
            raise PolicyError(
                f"{what}: there is no module {missing!r}; run from the directory that holds it, or "
                "install it"
            ) from None
        raise PolicyError(
            f"{what}: module {module_name!r} needs {missing!r}, which is not installed"
        ) from error
    except (TypeError, ValueError) as error:  # what importlib raises for '.name' and '..'
        if module_name.startswith("."):
            raise PolicyError(
                f"{what}: module {module_name!r} is relative; expected its full name"
            ) from error
        raise


def _find_attribute(what: str, module: ModuleType, path: str) -> object:
    target: object = module
    for part in path.split("."):
        try:
            target = getattr(target, part)
        except AttributeError:
            public = [choice for choice in dir(target) if not choice.startswith("_")]
            raise PolicyError(
                f"{what}: {module.__name__!r} has no {path!r}.{did_you_mean(part, public)}"
            ) from None
    return target


def _watching(
    name: str, target: object, act: Callable[[Mapping[str, np.ndarray]], object]
) -> Callable[[Mapping[str, np.ndarray]], object]:
    """The function `act` of an object, which logs an attribute that its second call sets.

    Its first call may load what it needs.
    """
    calls = itertools.count(1)

    def watched(observation: Mapping[str, np.ndarray]) -> object:
        if next(calls) != 2:
            return act(observation)
        before = {**getattr(target, "__dict__", {})}
        returned = act(observation)
        for attribute, value in getattr(target, "__dict__", {}).items():
            if before.get(attribute) is not value:
                log.warning(NOT_RESET, name, attribute)
                break
        return returned

    return watched


def _checking_policy(
    name: str, act: Callable[[Mapping[str, np.ndarray]], object], reset: Callable[[], object] | None
) -> Policy:
    def begin(spec: specs.BoundedArray, seed: int) -> Act:
        if reset is not None:
            with Locating(f"policy {name!r}, before the episode with seed {seed}"):
                reset()
        steps = itertools.count()

        def checked(observation: Mapping[str, np.ndarray]) -> np.ndarray:
            where = f"policy {name!r}, step {next(steps)} of the episode with seed {seed}"
            with Locating(where):
                returned = act(observation)
            action = as_numbers(where, returned, spec.shape)
            check_numbers(where, action, spec.dtype)
            return action

        return checked

    return begin
