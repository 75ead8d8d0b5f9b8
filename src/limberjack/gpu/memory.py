"""Whether a batch fits into a device's memory.

check(num_envs=4096, bytes_per_row=20_000, device=torch.device("cuda:0"))
"""

import os

from limberjack.gpu.backend import torch

__all__ = ["available", "check"]

_SHARE = 0.9  # of the free memory: kernels and PyTorch take some too


def available(device: torch.device) -> float:
    """Free memory of a device, bytes; infinite if unknown."""
    if device.type == "cuda":
        return torch.cuda.mem_get_info(device)[0]
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not on this system
        return float("inf")


def check(num_envs: int, bytes_per_row: int, device: torch.device) -> None:
    """Raises MemoryError if a batch of `num_envs` rows would not fit, with the number that would.

    Args:
      num_envs: number of rows.
      bytes_per_row: memory that a row takes.
      device: a `torch.device`.
    """
    free = available(device)
    if num_envs * bytes_per_row <= _SHARE * free:
        return
    raise MemoryError(
        f"num_envs is {num_envs}, which takes {num_envs * bytes_per_row / 1e9:.1f} GB on {device}, "
        f"where {free / 1e9:.1f} GB are free: at most {int(_SHARE * free / bytes_per_row)} rows of "
        f"{bytes_per_row / 1e3:.0f} kB fit; smaller nconmax or njmax make rows smaller"
    )
