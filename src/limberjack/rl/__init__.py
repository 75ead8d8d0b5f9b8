"""Reinforcement-learning interface: environments, batches, tasks and the physics contract.

from limberjack import rl

batch = rl.batch_of(environment, num_envs=256)      # see `limberjack.rl.batches`
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from limberjack.rl.batches import batch_of

__all__ = ["batch_of"]


def __getattr__(name: str) -> object:
    """Import `batch_of`, and with it MuJoCo, when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module("limberjack.rl.batches"), name)
