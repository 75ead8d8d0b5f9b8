"""What must agree for the state of one simulation to be loaded into another: `identity`.

identity(physics.model, varying=("body_mass",))
# {'MuJoCo': '4.0', 'model': 'humanoid', 'model sizes': [...], 'names': ..., 'numbers': ...}
"""

import functools
import zlib
from collections.abc import Sequence

import mujoco
import numpy as np

from limberjack.mujoco import fields
from limberjack.mujoco.wrapper.core import MjModel

__all__ = ["identity"]

_LOOKS = ("mat_", "tex_")  # what these fields hold changes pictures only, and so does ...
_COLOURS = "_rgba"  # ... what ends so, which rewards may be shown by


def identity(model: MjModel, varying: Sequence[str] = ()) -> dict[str, object]:
    """MuJoCo's major and minor version, and the model's name, sizes, names and numbers.

    Patch versions of MuJoCo give the same numbers.

    Args:
      model: the model.
      varying: its fields that episodes set, which are saved with each state instead.
    """
    official, shared = model._model, model._shared
    sizes = [official.nq, official.nv, official.na, official.nu, official.nbody, official.ngeom]
    kept = {} if shared is None else shared.identities
    fields_left_out = tuple(varying)
    if fields_left_out not in kept:
        kept[fields_left_out] = _checksum(official, fields_left_out)
    return {
        "MuJoCo": ".".join(mujoco.__version__.split(".")[:2]),
        "model": model.name,
        "model sizes": sizes,
        "names": zlib.crc32(official.names),
        "numbers": kept[fields_left_out],
    }


def _checksum(model: mujoco.MjModel, varying: tuple[str, ...]) -> int:
    checksum = 0
    for name in _numbers(varying):
        checksum = zlib.crc32(getattr(model, name).tobytes(), checksum)
    options = [np.asarray(getattr(model.opt, name)).tolist() for name in _options(varying)]
    return zlib.crc32(repr(options).encode(), checksum)


@functools.lru_cache(maxsize=64)
def _numbers(varying: tuple[str, ...]) -> list[str]:
    """Fields of floating point that do not vary, nor follow from those that do."""
    derived = mujoco.MjModel._setconst_outputs if fields.have_constants(varying) else ()
    return [
        name
        for name in fields.of_floats()
        if name not in varying and name not in derived
        if not name.startswith(_LOOKS) and not name.endswith(_COLOURS)
    ]


@functools.lru_cache(maxsize=64)
def _options(varying: tuple[str, ...]) -> list[str]:
    return [
        name
        for name in dir(mujoco.MjOption)
        if not name.startswith("_") and f"opt.{name}" not in varying
        if not callable(getattr(mujoco.MjOption, name))
    ]
