"""`find`: the policy that a name, or a Python object, stands for; `policy_for`: that of a task."""

import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import dm_env

from limberjack.policies import mlp, onnx
from limberjack.policies.built_in import OF_ACTIONS, PLANNER, of_actions, planner
from limberjack.policies.kinds import Actor
from limberjack.policies.named import actor_of, copied, instance_of, name_of, target_named
from limberjack.policies.networks import PRETRAINED, Network, loaded_policy, pretrained
from limberjack.policies.saved import is_saved_model, saved_policy
from limberjack.utils.sources import hash_of_module, hash_of_source

__all__ = ["find", "policy_for"]


def find(
    policy: object,
    environment: dm_env.Environment | None = None,
    *,
    num_threads: int | None = None,
    files: Mapping[Path, bytes] | None = None,
    is_shared: bool = False,
) -> Actor:
    """The policy of a name; see `limberjack.policies` for the names.

    Args:
      policy: one of the names; or the function, object or class that MODULE:CALLABLE would name,
        of which a network that `mlp.load` or `onnx.load` returns acts as its file would.
      environment: the one to act in, if it is known. A saved model that does not fit it, or a task
        that has no bundled policy, or no cost for the planner, is then refused here; with None as
        the first episode begins.
      num_threads: that the planner simulates with; by default all usable cores.
      files: of a saved model, as `policies.saved.read_model` returns them; None to read them.
      is_shared: other threads use the policy too, so an object with the state of episodes is
        copied.

    Raises:
      PolicyError: there is no policy of that name, it cannot be called, or it does not fit.
      TypeError: the environment is one of another library, without `action_spec`.
    """
    if environment is not None and not hasattr(environment, "action_spec"):
        raise TypeError(
            f"environment is of type {type(environment).__name__}; expected a dm_env.Environment, "
            "such as suite.load makes; in a loop of Gymnasium's, call the method actions of "
            "limberjack.policies.mlp.load(PATH)"
        )
    if not isinstance(policy, str):
        name = name_of(policy)
        if type(policy) in (mlp.Mlp, onnx.OnnxPolicy):
            return loaded_policy(name, cast(Network, policy), environment)
        target = instance_of(name, policy) if inspect.isclass(policy) else policy
        return actor_of(name, hash_of_source(policy), target)
    if policy in OF_ACTIONS:
        return of_actions(policy)
    if policy == PLANNER:
        return planner(environment, num_threads)
    if policy == PRETRAINED:
        return pretrained(environment)
    if is_saved_model(policy):
        return saved_policy(policy, environment, files)
    target = target_named(policy)
    if is_shared:
        target = copied(policy, target)
    return actor_of(policy, hash_of_module(policy.partition(":")[0]), target)


def policy_for(policies: object, domain: str, task: str) -> object:
    """The policy of a task among those of a set of tasks; None if there is none.

    Args:
      policies: a name, in which {domain} and {task} stand for those of the task; a mapping of
        policies by (domain, task); or one policy for all.
      domain: such as 'humanoid'.
      task: such as 'walk'.
    """
    if isinstance(policies, Mapping):
        return policies.get((domain, task))
    if isinstance(policies, str):
        return policies.replace("{domain}", domain).replace("{task}", task)
    return policies
