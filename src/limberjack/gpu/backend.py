"""PyTorch, Warp and MuJoCo Warp, for the other modules of this folder; needs the extra `gpu`.

    from limberjack.gpu.backend import torch

    device_of("cuda:0")     # torch.device("cuda:0")

No other file imports these packages. If a device cannot be used, `device_of` says what is missing.
"""

from limberjack.utils.requirements import missing_extra

try:
    import torch  # pyright: ignore[reportMissingImports]
    import warp  # pyright: ignore[reportMissingImports]

    warp.config.log_level = warp.LOG_WARNING  # else it prints its version and what it compiles
    import mujoco_warp  # pyright: ignore[reportMissingImports]
except ImportError as error:
    raise missing_extra("gpu") from error

__all__ = ["device_of", "devices", "mujoco_warp", "torch", "warp"]


def device_of(name: object) -> torch.device:
    """The `torch.device` of a name such as 'cuda:0', 'cuda' or 'cpu'.

    Raises:
      ValueError: there is no such device, or PyTorch or Warp cannot use it; the message says what
        to install.
    """
    try:
        device = torch.device(name)
    except (RuntimeError, TypeError) as error:
        raise ValueError(
            f"device is {name!r}; expected 'cuda:0', 'cuda:1', ... or 'cpu'"
        ) from error
    if device.type == "cpu":
        return torch.device("cpu")
    if device.type != "cuda":
        raise ValueError(
            f"device is {name!r}; MuJoCo Warp runs on 'cuda:0', 'cuda:1', ... or 'cpu'"
        )
    number = device.index or 0
    if not torch.cuda.is_available():
        raise ValueError(
            f"device is {name!r}, but PyTorch {torch.__version__} finds no CUDA device: install "
            "NVIDIA's driver and PyTorch for CUDA (https://pytorch.org), or give device='cpu'"
        )
    if number >= torch.cuda.device_count():
        raise ValueError(
            f"device is {name!r}; this machine has {torch.cuda.device_count()} CUDA devices, "
            "numbered from 0"
        )
    found = [one.alias for one in warp.get_cuda_devices()]
    if f"cuda:{number}" not in found:
        raise ValueError(
            f"device is {name!r}, which PyTorch can use but Warp {warp.__version__} cannot: "
            "install a newer driver of NVIDIA"
        )
    return torch.device("cuda", number)


def devices() -> list[str]:
    """Each CUDA device in words: its name and memory.

    Raises:
      ValueError: none can be used; the message says what to install.
    """
    device_of("cuda:0")
    found = (torch.cuda.get_device_properties(i) for i in range(torch.cuda.device_count()))
    return [f"{one.name}, {one.total_memory / 1e9:.0f} GB" for one in found]
