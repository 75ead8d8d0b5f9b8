"""`find`: the policy that a name, or a Python object, stands for."""

import inspect

import dm_env

from limberjack.policies.built_in import BUILT_IN
from limberjack.policies.kinds import Policy
from limberjack.policies.named import instance_of, name_of, policy_of, target_named
from limberjack.policies.saved import is_saved_model, saved_policy

__all__ = ["find"]


def find(policy: object, environment: dm_env.Environment | None = None) -> Policy:
    """The policy of a name; see `limberjack.policies` for the names.

    Args:
      policy: 'zero', 'random', 'planner', 'MODULE:CALLABLE' or 'sb3:PATH'; or the function, object
        or class that MODULE:CALLABLE would name.
      environment: the one to act in, if it is known. A saved model that does not fit it is then
        refused here; with None it is refused as its first episode begins.

    Raises:
      PolicyError: there is no policy of that name, it cannot be called, or it does not fit.
    """
    if not isinstance(policy, str):
        name = name_of(policy)
        return policy_of(name, instance_of(name, policy) if inspect.isclass(policy) else policy)
    if policy in BUILT_IN:
        return BUILT_IN[policy]
    if is_saved_model(policy):
        return saved_policy(policy, environment)
    return policy_of(policy, target_named(policy))
