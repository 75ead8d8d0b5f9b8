"""`identity`: facts that must match for one simulation's state to load into another.

identity(physics.model, varying=("body_mass",))
# {'MuJoCo': '4.0', 'model': 'humanoid', 'model sizes': [...], ..., 'numbers of the model': {...}}
"""

import zlib
from collections.abc import Sequence

import mujoco

from limberjack.mujoco import model_values
from limberjack.mujoco.wrapper.core import MjModel

__all__ = ["identity"]

_DRAWN_ONLY = ("_rgba", "tex_data")  # suffixes of fields that affect only pictures


def identity(model: MjModel, varying: Sequence[str] = ()) -> dict[str, object]:
    """MuJoCo's major and minor version; the model's name, sizes, object names and field checksums.

    MuJoCo's patch version is left out, because patch releases give the same numbers.

    Args:
      model: the model.
      varying: model fields set per episode, which are saved with each state instead.
    """
    official, shared = model._model, model._shared
    sizes = [official.nq, official.nv, official.na, official.nu, official.nbody, official.ngeom]
    kept = {} if shared is None else shared.checksums
    if tuple(varying) not in kept:
        kept[tuple(varying)] = _numbers(official, varying)
    return {
        "MuJoCo": ".".join(mujoco.__version__.split(".")[:2]),
        "model": model.name,
        "model sizes": sizes,
        "names": zlib.crc32(official.names),
        "numbers of the model": kept[tuple(varying)],
    }


def _numbers(model: mujoco.MjModel, varying: Sequence[str]) -> dict[str, int]:
    """A checksum of each field that neither varies nor is derived from fields that do."""
    leave_out = {*varying, *model_values.derived_fields(varying), "tex_data"}
    checksums = model_values.checksums(model, leave_out)
    return {name: n for name, n in checksums.items() if not name.endswith(_DRAWN_ONLY)}
