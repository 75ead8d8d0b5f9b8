"""PyTorch, Warp and MuJoCo Warp, for the other modules of this folder; needs the extra `gpu`.

    from limberjack.gpu.backend import torch

No other file imports these packages.
"""

from limberjack.utils.requirements import missing_extra

try:
    import torch  # pyright: ignore[reportMissingImports]
    import warp  # pyright: ignore[reportMissingImports]

    warp.config.log_level = warp.LOG_WARNING  # else it prints its version and what it compiles
    import mujoco_warp  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise missing_extra("gpu") from error

__all__ = ["mujoco_warp", "torch", "warp"]
