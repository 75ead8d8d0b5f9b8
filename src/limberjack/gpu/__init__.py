"""Vector environments on a GPU, stepped by MuJoCo Warp; needs the extra `gpu`.

    from limberjack import gpu

    envs = gpu.load_vector("humanoid", "walk", num_envs=4096, device="cuda:0", seed=0)
    observations, info = envs.reset()
    observations, rewards, terminated, truncated, info = envs.step(actions)    # tensors

Tasks are those of the suite, or your own: their NumPy code runs on tensors as it is. `REFUSED` maps
the suite's tasks that cannot run on a device to the reason; loading one raises ValueError with it.

Verified on Warp's CPU device; not measured on a GPU yet: see docs/gpu.md.
"""

import importlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from limberjack.gpu.vector import VectorEnv, load_vector

__all__ = ["REFUSED", "VectorEnv", "load_vector"]

# A test compares the list with the tasks that load.
REFUSED: Mapping[tuple[str, str], str] = MappingProxyType(
    {
        ("point_mass", "hard"): (
            "each episode draws the directions of the controls (wrap_prm), which MuJoCo Warp "
            "shares between all rows"
        ),
        ("quadruped", "escape"): (
            "each episode draws a terrain (hfield_data), which MuJoCo Warp shares between all rows"
        ),
    }
)


def __getattr__(name: str) -> object:
    """Import a name that needs the extra when it is first used."""
    if name not in ("VectorEnv", "load_vector"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module("limberjack.gpu.vector"), name)
