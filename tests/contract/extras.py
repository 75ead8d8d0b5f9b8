"""Which modules need the packages of an extra, and which of those are not installed here."""

import importlib.util

from .source import modules

__all__ = ["MADE_OF", "MISSING"]

# Modules of `limberjack.gpu` that import its `backend`.
_ON_TENSORS = tuple(
    f"limberjack.gpu.{name}"
    for name in (
        *("backend", "batch", "functions", "model_fields"),
        *("speed", "tensors", "vector", "warp_simulation"),
    )
)
# Modules, or packages with all of theirs, that depend on a package of an extra: without it, they or
# their names cannot be imported.
MADE_OF = {
    "limberjack.data": ("pyarrow", "data"),
    "limberjack.episodes.to_minari": ("minari", "minari"),
    "limberjack.episodes.remote": ("fsspec", "data"),
    "limberjack.episodes.torch_datasets": ("torch", "torch"),
    "limberjack.adapters.rsl_rl": ("mujoco_warp", "gpu"),
    "limberjack.adapters.sb3": ("stable_baselines3", "sb3"),
    "limberjack.sb3": ("stable_baselines3", "sb3"),
    "limberjack.training.learner": ("sbx", "train"),
    "limberjack.workers.ray_tasks": ("ray", "ray"),
    "limberjack.gpu": ("mujoco_warp", "gpu"),  # its names
    **dict.fromkeys(_ON_TENSORS, ("mujoco_warp", "gpu")),
}

# Modules that cannot be used here, with the package that is not installed and its extra.
MISSING = {
    module: (package, extra)
    for name, (package, extra) in MADE_OF.items()
    if importlib.util.find_spec(package) is None
    for module in modules()
    if f"{module}.".startswith(f"{name}.")
}
