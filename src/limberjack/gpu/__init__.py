"""Vector environments on a GPU, stepped by MuJoCo Warp; needs the extra `gpu`.

    from limberjack import gpu

    envs = gpu.load_vector("humanoid", "walk", num_envs=4096, device="cuda:0", seed=0)
    observations, info = envs.reset()
    observations, rewards, terminated, truncated, info = envs.step(actions)    # tensors

Tasks are those of the suite, or your own: their NumPy code runs on tensors as it is. `REFUSED` has
the tasks that need something which rows cannot have on a device, with the reason.

Verified on Warp's CPU device; not measured on a GPU yet: see docs/gpu.md.
"""

import importlib
from typing import TYPE_CHECKING

from limberjack.gpu.refused import REFUSED

if TYPE_CHECKING:
    from limberjack.gpu.vector import VectorEnv, load_vector

__all__ = ["REFUSED", "VectorEnv", "load_vector"]


def __getattr__(name: str) -> object:
    """Import a name that needs the extra when it is first used."""
    if name not in ("VectorEnv", "load_vector"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module("limberjack.gpu.vector"), name)
