"""Gymnasium environments of the suite: `Env` for one simulation, `VectorEnv` for a batch.

    import gymnasium

    env = gymnasium.make("limberjack/humanoid-walk-v0")
    envs = gymnasium.make_vec(
        "limberjack/humanoid-walk-v0", num_envs=256, vectorization_mode="vector_entry_point"
    )

Importing this module registers the ids; it does not import MuJoCo. `load` and `load_vector` make
the same environments without an id, and take the same arguments. Environments with a task of your
own come from `Env(environment)` and `VectorEnv(batch)`.
"""

import importlib
from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from limberjack.gym.env import Env, load
    from limberjack.gym.observations import Part
    from limberjack.gym.vector import VectorEnv, load_vector

__all__ = ["Env", "Part", "VectorEnv", "load", "load_vector"]

# Written out, so that registering needs no MuJoCo; a test compares them with the suite.
_TASKS = {
    "humanoid": ("run", "run_pure_state", "stand", "walk"),
    "manipulator": ("bring_ball", "bring_peg", "insert_ball", "insert_peg"),
    "stacker": ("stack_2", "stack_4"),
}
_MODULES = {
    "Env": "limberjack.gym.env",
    "load": "limberjack.gym.env",
    "Part": "limberjack.gym.observations",
    "VectorEnv": "limberjack.gym.vector",
    "load_vector": "limberjack.gym.vector",
}


def __getattr__(name: str) -> Any:  # Any: whatever is exported
    """Imports what is exported when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)


def _register() -> None:
    """Registers every task that is not registered yet."""
    for domain, tasks in _TASKS.items():
        for task in tasks:
            name = f"limberjack/{domain}-{task}-v0"
            if name in gymnasium.registry:
                continue
            gymnasium.register(
                name,
                entry_point="limberjack.gym.env:load",
                vector_entry_point="limberjack.gym.vector:load_vector",
                kwargs={"domain": domain, "task": task},
            )


_register()
