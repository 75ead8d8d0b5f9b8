"""Policies that act in all rows of a batch, and what identifies them in results.

    found = find("random")                  # or "MODULE:CALLABLE", "sb3:model.zip", "planner"
    if found.actor is not None:
        found.actor.begin(spec, rows, seeds)             # episodes begin in these rows
        actions = found.actor.act(observation, rows)     # (num_envs, nu); zeros in other rows

`limberjack.policies` resolves the names, and its module `batched` acts on rows. A function of one
observation is called for row after row; an object with `reset` keeps the state of one episode, and
plays one at a time.
"""

import copy
import dataclasses
import hashlib
import inspect
from collections.abc import Mapping
from pathlib import Path

import dm_env

from limberjack import policies
from limberjack.policies import Policy, PolicyError
from limberjack.policies.batched import Actor, Batched, EachRow
from limberjack.policies.named import (
    batch_functions,
    instance_of,
    is_stateful_object,
    policy_of,
    target_named,
)
from limberjack.policies.saved import load_model
from limberjack.rl.batches import vectorisable
from limberjack.utils.sources import hash_of_files, hash_of_module, hash_of_source

__all__ = ["Found", "find"]

_PLANNER = "planner"


@dataclasses.dataclass(frozen=True)
class Found:
    """A policy, as a batch plays it."""

    name: str
    sha256: str | None  # of its source or its file; None if that is not known
    actor: Actor | None  # None: it plays one episode at a time,
    alone: Policy | None  # as this


def find(
    policy: object,
    environment: dm_env.Environment | None,
    num_threads: int | None = None,
    files: Mapping[Path, bytes] | None = None,
    *,
    is_shared: bool = False,
) -> Found:
    """The policy of a name; see `limberjack.policies` for the names.

    Args:
      policy: 'zero', 'random', 'planner', 'MODULE:CALLABLE', 'sb3:PATH'; or the function, object
        or class itself.
      environment: that it is to act in; None where neither the planner nor a model is asked for.
      num_threads: that the planner simulates with; by default the cores that it may use.
      files: of a saved model, as `policies.saved.read_model` returns them; None to read them.
      is_shared: other threads use the policy too, so an object with the state of episodes is
        copied.

    Raises:
      PolicyError: there is none, or it cannot be used here.
    """
    if not isinstance(policy, str):
        return _of_object(policies.name_of(policy), policy)
    if policies.is_saved_model(policy):
        return _of_saved_model(policy, environment, files)
    if policy == _PLANNER:
        return _of_planner(environment, num_threads)
    if ":" not in policy:
        found = policies.find(policy)
        return Found(policy, _hash(inspect.getsource(found).encode()), EachRow(found), None)
    target = target_named(policy)
    if is_shared and is_stateful_object(policy):
        target = _copied(policy, target)
    found = _of_object(policy, target)
    return dataclasses.replace(found, sha256=hash_of_module(policy.partition(":")[0]))


def _of_object(name: str, target: object) -> Found:
    """A policy given as an object, a function or a class."""
    sha256 = hash_of_source(target)
    if inspect.isclass(target):
        target = instance_of(name, target)
    functions = batch_functions(name, target)
    if functions is not None:
        return Found(name, sha256, Batched(name, *functions), None)
    policy = policy_of(name, target)
    if getattr(target, "reset", None) is not None:
        return Found(name, sha256, None, policy)
    return Found(name, sha256, EachRow(policy), None)


def _copied(name: str, target: object) -> object:
    try:
        return copy.deepcopy(target)
    except Exception as error:  # of any class: it is the user's object
        raise PolicyError(
            f"policy {name!r} is an object that cannot be copied ({error}), and threads would "
            "share its state: name its class, or give each worker one thread in its own process"
        ) from error


def _of_planner(environment: dm_env.Environment | None, num_threads: int | None) -> Found:
    from limberjack.planner.cost import sources_for

    assert environment is not None
    try:
        sources = sources_for(vectorisable(environment).task)
    except ValueError as error:
        raise PolicyError(f"policy {_PLANNER!r}: {error}") from error
    return Found(_PLANNER, hash_of_files(sources), None, policies.planner_with(num_threads))


def _of_saved_model(
    name: str, environment: dm_env.Environment | None, files: Mapping[Path, bytes] | None
) -> Found:
    """The policy of a model that Stable-Baselines3 has saved."""
    assert environment is not None
    model = load_model(name, environment, files)
    sha256 = _hash(b"".join(model.files.values()))
    return Found(name, sha256, Batched(name, model.act_batch), None)


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
