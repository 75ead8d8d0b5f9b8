"""Everything that an episode depends on except its seed, and a digest that proves it by playing.

    identity_of(factory, found, environment)      # {'domain': 'humanoid', 'task': 'walk', ...}
    canary_of(factory)                            # SHA-256 of 50 steps
    processor()                                   # 'AMD EPYC 7B13, glibc 2.36'

Equal identities promise equal episodes on one kind of machine only: mathematical routines of
another processor or C library may round differently. The canary detects that.
"""

import contextlib
import functools
import hashlib
import platform
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import dm_env
import numpy as np

from limberjack import policies
from limberjack.mujoco.fingerprint import fingerprint, versions
from limberjack.policies import Actor
from limberjack.rl.control import Environment, PhysicsError
from limberjack.rl.copies import control_of
from limberjack.rl.row_step import as_mapping
from limberjack.utils.facts import Facts
from limberjack.workers.factories import Factory

__all__ = [
    "advice_on",
    "canary_of",
    "first_difference",
    "first_mismatch",
    "identity_of",
    "processor",
]

_CANARY_STEPS = 50
_CANARY_SEED = 0
# Fields that another kind of processor may change.
_BY_PROCESSOR = ("fingerprint", "canary")
_CPU_INFO = Path("/proc/cpuinfo")


def identity_of(
    factory: Factory,
    actor: Actor,
    environment: dm_env.Environment,
    action_repeat: int | None = None,
) -> Facts:
    """Everything that an episode depends on except its seed, as values of JSON.

    Args:
      factory: made the environment.
      actor: the policy.
      environment: one that the factory made.
      action_repeat: control steps per action; None for the environment's own.
    """
    inner = control_of(environment)
    assert isinstance(inner, Environment)
    limit, control_timestep = Environment.step_limit.of(inner), inner.control_timestep()
    facts: dict[str, object] = {
        **factory.facts,
        "policy": actor.name,
        "policy_sha256": actor.sha256,
        "time_limit": None if limit is None else limit * control_timestep,
        "control_timestep": control_timestep,
        "action_repeat": inner._ours.action_repeat if action_repeat is None else action_repeat,
        "world": Environment.world.of(inner),
        "versions": versions(),
        "fingerprint": fingerprint(inner.physics.model._official),
    }
    return cast(Facts, facts)


def canary_of(factory: Factory) -> str:
    """SHA-256 of the observations and rewards of 50 steps of fixed actions, in hex.

    The actions are those of the policy `random` with seed 0. A shorter episode ends the canary.

    Raises:
      PolicyError: the task's actions have no bounds to draw from.
    """
    digest = hashlib.sha256()
    with contextlib.closing(factory.make(_CANARY_SEED)) as environment:
        time_step = environment.reset()
        act = policies.find("random").begin_alone(environment, _CANARY_SEED)
        _add(digest, 0.0, time_step.observation)
        for _ in range(_CANARY_STEPS):
            if time_step.last():
                break
            try:
                time_step = environment.step(act(time_step.observation))
            except PhysicsError:
                digest.update(b"diverged")
                break
            _add(digest, time_step.reward, time_step.observation)
    return digest.hexdigest()


def _add(digest: "hashlib._Hash", reward: float, observation: object) -> None:
    digest.update(np.float64(reward).tobytes())
    for name, value in as_mapping(observation).items():
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(np.asarray(value)).tobytes())


@functools.cache
def processor() -> str:
    """The processor and the C library, whose mathematical routines round the results."""
    library = " ".join(platform.libc_ver()).strip()
    return ", ".join(part for part in (_model_name(), library) if part)


_Difference = tuple[str, object, object]


def first_difference(
    expected: Mapping[str, object], found: Mapping[str, object], any_processor: bool = False
) -> _Difference | None:
    """Name, expected and found value of the first field that differs; None if all are equal.

    Args:
      expected: of the driver.
      found: of a worker. Fields of dictionaries are compared one by one: 'versions.mujoco'.
      any_processor: ignore what another kind of processor may change.
    """
    for name in {**expected, **found}:
        one, other = expected.get(name), found.get(name)
        if any_processor and name in _BY_PROCESSOR:
            continue
        if isinstance(one, dict) and isinstance(other, dict):
            within = first_difference(one, other)
            if within is not None:
                return f"{name}.{within[0]}", *within[1:]
        elif one != other:
            return name, one, other
    return None


def first_mismatch(
    expected: Mapping[str, object], kept: Mapping[str, object], any_processor: bool = False
) -> _Difference | None:
    """First field by which kept episodes belong to another experiment; None if all match.

    Patch numbers of versions may differ, and further fields may be kept.

    Args:
      expected: the present identity, with the canary.
      kept: the one that was saved with the episodes.
      any_processor: as above.
    """
    for name, here in expected.items():
        there = kept.get(name)
        if any_processor and name in _BY_PROCESSOR:
            continue
        if name == "versions":
            there, here = _differing(there, here)
        if there != here:
            return name, here, there
    return None


def advice_on(name: str) -> str:
    """Advice to add to a message that such a field differs; empty without any."""
    if name not in _BY_PROCESSOR:
        return ""
    return "; where only the processor differs, --any-processor accepts it"


def _differing(found: object, expected: object) -> tuple[object, object]:
    """The entries of two tables of versions that differ in more than their patch numbers."""
    if not (isinstance(found, dict) and isinstance(expected, dict)):
        return found, expected
    names = [n for n in {**found, **expected} if _series(found.get(n)) != _series(expected.get(n))]
    return {n: found.get(n) for n in names}, {n: expected.get(n) for n in names}


def _series(version: object) -> list[str]:
    """The major and the minor number of a version."""
    return str(version).split(".")[:2]


def _model_name() -> str:
    """The processor as the system names it."""
    with contextlib.suppress(OSError):
        for line in _CPU_INFO.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()
