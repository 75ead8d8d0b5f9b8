"""The packages that optional features need, and the error that names them where one is missing.

    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise missing_extra("video") from error
    # ImportError: needs the extra 'video': pip install imageio-ffmpeg matplotlib

Messages name these packages and never `limberjack[...]`: Limberjack is on no package index, where
that name would lead to another project. pyproject.toml lists the same packages with versions.
"""

import shlex
from collections.abc import Mapping
from types import MappingProxyType

__all__ = [
    "MUJOCO",
    "MUJOCO_DISTRIBUTIONS",
    "MUJOCO_REMEDY",
    "PACKAGES",
    "install_command",
    "missing_extra",
]

MUJOCO = "mujoco>=4.0,<5"
MUJOCO_DISTRIBUTIONS = ("mujoco", "mujoco-core", "mujoco-studio")  # they share one folder
# Two commands: pip alone, replacing MuJoCo 3, removes files of MuJoCo 4 along with the old ones.
MUJOCO_REMEDY = (
    f"run: pip uninstall -y {' '.join(MUJOCO_DISTRIBUTIONS)}; then: pip install '{MUJOCO}'. "
    "Programs that need MuJoCo 3, as dm_control does, belong into another virtual environment"
)

_GPU = ("mujoco-warp", "torch", "warp-lang")
_FILMS = ("imageio-ffmpeg", "matplotlib")
PACKAGES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "video": _FILMS,
        "notebook": (*_FILMS, "ipykernel"),
        "data": ("pyarrow",),
        "minari": ("minari", "pillow", "pyarrow"),
        "sb3": ("stable-baselines3",),
        "torchrl": ("torchrl",),
        "rllib": ("ray[rllib]", "torch"),
        "ray": ("ray",),
        "gpu": _GPU,
        "rsl-rl": (*_GPU, "rsl-rl-lib"),
        "unilab-rl": (*_GPU, "unilab-rl"),
        "gymnasium": ("moviepy", "pygame"),
    }
)


def install_command(extra: str) -> str:
    """The command that installs the packages of an extra, for a shell."""
    return f"pip install {shlex.join(PACKAGES[extra])}"


def missing_extra(extra: str) -> ImportError:
    """The error to raise where a package of an extra is not installed."""
    return ImportError(f"needs the extra {extra!r}: {install_command(extra)}")
