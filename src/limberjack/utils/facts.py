"""`Facts`: what identifies results, as values of JSON by name.

facts = {"domain": "humanoid", "task": "walk", "policy": "random", "versions": {...}}
title_of(facts)     # 'humanoid walk'
"""

from collections.abc import Mapping
from typing import NotRequired, TypedDict

__all__ = ["Facts", "title_of"]


class Facts(TypedDict):
    """The environments, the policy, and all else that episodes depend on except for their seeds.

    Attributes:
      domain, task: of the suite, or registered; absent for a user's own environments.
      domain_sha256: the hash of a registered domain's module, if that is known; absent for the
        suite's, and in results of earlier versions.
      environment, environment_sha256: the function that makes these, and the hash of its source,
        if that is known; absent for those of a domain.
      policy, policy_sha256: its name, and the hash of its source or file, if that is known.
      time_limit: seconds of an episode; None without one.
      control_timestep: seconds.
      action_repeat: control steps per action.
      world: options by which the world differs from the suite's; absent or None if it does not.
      versions: of the packages, by name.
      fingerprint: of the compiled model; see `mujoco.fingerprint`.
    """

    domain: str
    task: str
    domain_sha256: NotRequired[str | None]
    environment: str
    environment_sha256: str | None
    policy: str
    policy_sha256: str | None
    time_limit: float | None
    control_timestep: float
    action_repeat: int
    world: Mapping[str, object] | None
    versions: Mapping[str, str]
    fingerprint: str


def title_of(facts: Mapping[str, object]) -> str:
    """The task that facts are about, or the function that made its environments."""
    return str(facts.get("environment") or f"{facts['domain']} {facts['task']}")
