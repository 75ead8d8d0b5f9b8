"""Gymnasium environments of the suite: `Env` for one simulation, `VectorEnv` for a batch.

    import gymnasium
    import limberjack

    env = gymnasium.make("limberjack/humanoid-walk-v0")
    envs = gymnasium.make_vec("limberjack/humanoid-walk-v0", num_envs=256)

Importing this module, as `import limberjack` does, registers the ids of the suite from its table,
without importing MuJoCo or a domain. The ids of another domain appear when it is registered. `load`
and `load_vector` make the same environments without an id; `Env(environment)` and
`VectorEnv(batch)` make them from a task of your own.
"""

import importlib
import re
from typing import TYPE_CHECKING

import gymnasium

from limberjack import registry

if TYPE_CHECKING:
    from limberjack.gym.env import Env, load
    from limberjack.gym.loading import load_vector
    from limberjack.gym.made import restore
    from limberjack.gym.many import ManyVectorEnv
    from limberjack.gym.observations import Part
    from limberjack.gym.vector import VectorEnv

__all__ = ["Env", "ManyVectorEnv", "Part", "VectorEnv", "load", "load_vector", "restore"]

_MODULES = {
    "Env": "limberjack.gym.env",
    "load": "limberjack.gym.env",
    "Part": "limberjack.gym.observations",
    "ManyVectorEnv": "limberjack.gym.many",
    "VectorEnv": "limberjack.gym.vector",
    "load_vector": "limberjack.gym.loading",
    "restore": "limberjack.gym.made",
}


_NAME = re.compile(r"limberjack/[\w.-]+")  # the ids that Gymnasium accepts


def __getattr__(name: str) -> object:
    """Import a public name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def _follow(domain: registry.Domain, is_added: bool) -> None:
    """Register the ids of a domain, or remove them."""
    for row in domain.rows:
        name = f"limberjack/{row.domain}-{row.task}-v0"
        if not _NAME.fullmatch(name):  # names assigned to `suite._DOMAINS` are not checked
            continue
        gymnasium.registry.pop(name, None)
        if not is_added:
            continue
        kwargs: dict[str, object] = {"domain": row.domain, "task": row.task}
        if domain.source != "suite":
            kwargs["steps"] = row.steps
            kwargs["module"] = domain.import_name or registry.NotImportable(domain.name)
        gymnasium.register(
            name,
            entry_point="limberjack.gym.made:make",
            vector_entry_point="limberjack.gym.made:make_vector",
            max_episode_steps=row.steps,
            kwargs=kwargs,
        )


registry.listen(_follow)

# Several tasks: `gymnasium.make_vec(id, num_envs=16, tasks=["cheetah:run", "walker:walk"])`.
gymnasium.register(
    "limberjack/many-v0",
    vector_entry_point="limberjack.gym.made:make_many",
)
