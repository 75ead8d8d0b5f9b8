"""The packages that optional features need, and the error that names them where one is missing.

    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise missing_extra("video") from error
    # ImportError: needs the extra 'video': pip install imageio-ffmpeg matplotlib pillow

Messages name these packages and never `limberjack[...]`: Limberjack is on no package index, where
that name would lead to another project. pyproject.toml lists the same packages with versions.
"""

import shlex
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

__all__ = [
    "MUJOCO",
    "MUJOCO_BROKEN",
    "MUJOCO_COMMANDS",
    "MUJOCO_DISTRIBUTIONS",
    "MUJOCO_REMEDY",
    "PACKAGES",
    "broken_mujoco",
    "install_command",
    "is_of_mujoco",
    "missing_extra",
]

MUJOCO = "mujoco>=4.0,<5"
MUJOCO_DISTRIBUTIONS = ("mujoco", "mujoco-core", "mujoco-studio")  # they share one folder
# Two commands: pip alone, replacing MuJoCo 3, removes files of MuJoCo 4 along with the old ones.
# MuJoCo's own advice, to install its packages again without their dependencies, mixes versions.
MUJOCO_COMMANDS = (
    f"pip uninstall -y {' '.join(MUJOCO_DISTRIBUTIONS)}",
    f"pip install '{MUJOCO}'",
)
_ELSEWHERE = (
    "Programs that need MuJoCo 3, as dm_control does, belong into another virtual environment"
)
MUJOCO_BROKEN = "MuJoCo cannot be imported"  # beginning of the reason
MUJOCO_REMEDY = f"run: {MUJOCO_COMMANDS[0]}; then: {MUJOCO_COMMANDS[1]}. {_ELSEWHERE}"

_GPU = ("mujoco-warp", "torch", "warp-lang")
_FILMS = ("imageio-ffmpeg", "matplotlib", "pillow")
PACKAGES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "video": _FILMS,
        "notebook": (*_FILMS, "ipykernel"),
        "data": ("fsspec", "pyarrow"),
        "torch": ("fsspec", "pyarrow", "torch"),
        "minari": ("fsspec", "minari", "pillow", "pyarrow"),
        "onnx": ("onnx", "onnxruntime"),
        "sb3": ("sb3-contrib", "stable-baselines3"),
        "train": ("sbx-rl", "stable-baselines3", "tensorboard", "torch"),
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


def broken_mujoco(why: object) -> ImportError:
    """The error to raise where MuJoCo cannot be imported, with commands on lines of their own.

    Args:
      why: a sentence, or the error that importing it raised, whose advice is left out.
    """
    commands = "\n".join(f"  {command}" for command in MUJOCO_COMMANDS)
    if isinstance(why, ImportError):
        text = str(why).replace(f"; {MUJOCO_REMEDY}", "")
        if commands in text:
            return why
        sentence, _, _ = text.splitlines()[0].partition(". ") if text else ("", "", "")
        sentence, _, _ = sentence.partition(" (for example")
        why = f"{MUJOCO_BROKEN}: {sentence or type(why).__name__}"
    return ImportError(
        f"{why}. pip leaves such an installation where it replaces MuJoCo 3 or mixes versions. "
        f"Run these commands, one after the other:\n{commands}\n{_ELSEWHERE}.",
        name="mujoco",
    )


def is_of_mujoco(error: BaseException) -> bool:
    """Whether an error comes from importing a MuJoCo that is damaged, too old or missing."""
    if not isinstance(error, ImportError):
        return False
    if (error.name or "").partition(".")[0] == "mujoco" or MUJOCO_REMEDY in str(error):
        return True
    files = [frame.filename for frame in traceback.extract_tb(error.__traceback__)]
    return any(Path(file).parts[-2:] == ("mujoco", "__init__.py") for file in files[-1:])
