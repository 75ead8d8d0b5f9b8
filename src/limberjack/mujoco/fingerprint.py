"""`fingerprint` of a compiled model, and the `versions` of the packages that numbers depend on."""

import hashlib
import platform
from typing import TYPE_CHECKING

import numpy as np

import limberjack
from limberjack.mujoco.official import mujoco

if TYPE_CHECKING:
    from hashlib import _Hash

    from mujoco import MjModel

__all__ = ["fingerprint", "versions"]

# Fields that depend on the files of a model and on its compiler, not on the model itself.
_NOT_OF_THE_MODEL = ("paths", "signature")


def versions() -> dict[str, str]:
    """The versions of the packages that numbers depend on."""
    return {
        "limberjack": limberjack.__version__,
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def fingerprint(model: "MjModel") -> str:
    """SHA-256 over the names and values of all fields of a compiled `mujoco.MjModel`, in hex.

    Equal models have equal fingerprints, wherever their files lie and however often they are
    compiled. Compilers and processors that round differently give models that differ.
    """
    digest = hashlib.sha256()
    _add_fields(digest, "", model)
    return digest.hexdigest()


def _add_fields(digest: "_Hash", prefix: str, struct: object) -> None:
    """Add every public field of a MuJoCo struct, including those of the structs within it."""
    for name in sorted(dir(struct)):
        if name.startswith("_") or name in _NOT_OF_THE_MODEL or name.endswith("pathadr"):
            continue
        value = getattr(struct, name)
        if callable(value):
            continue
        full = f"{prefix}{name}"
        if isinstance(value, np.ndarray):
            digest.update(f"{full} {value.dtype.str}{value.shape}".encode())
            digest.update(np.ascontiguousarray(value).tobytes())
        elif isinstance(value, int | float | bytes):
            digest.update(f"{full} {value!r}".encode())
        else:
            _add_fields(digest, f"{full}.", value)
