"""`checksums` and `identity`: the numbers of a compiled model, for fast comparison.

before = checksums(model)  # one for each field
...
changed_fields(before, checksums(model))  # ["body_pos"]
identity(physics.model, varying=("body_mass",))  # must match for a state to load
# {'MuJoCo': '4.0', 'model': 'humanoid', 'model sizes': [...], ..., 'numbers of the model': {...}}
"""

import functools
import operator
import zlib
from collections.abc import Container, Iterable, Sequence
from types import UnionType

import mujoco
import numpy as np

from limberjack.mujoco.wrapper.core import MjModel
from limberjack.mujoco.wrapper.model import empty_model

__all__ = ["array_names", "changed_fields", "checksums", "derived_fields", "identity"]

_DRAWN_ONLY = ("_rgba", "tex_data")  # suffixes of fields that affect only pictures


def checksums(model: mujoco.MjModel, leave_out: Container[str] = ()) -> dict[str, int]:
    """A checksum per non-empty model field; options are named as 'opt.gravity'.

    Takes 0.2 ms, or 2 ms including texture pixels (`tex_data`).
    """
    found = {}
    for name in array_names():
        if name in leave_out:
            continue
        field = getattr(model, name)
        if field.size:
            found[name] = zlib.crc32(field)
    for name in _option_names():
        if name not in leave_out:
            found[name] = zlib.crc32(np.asarray(operator.attrgetter(name)(model)).tobytes())
    return found


def changed_fields(before: dict[str, int], after: dict[str, int]) -> list[str]:
    """Sorted names of the fields whose numbers differ or that only one model has."""
    return sorted(
        name for name in before.keys() | after.keys() if before.get(name) != after.get(name)
    )


def derived_fields(fields: Iterable[str]) -> frozenset[str]:
    """Fields that MuJoCo recomputes (mj_setConst) if these are set per episode."""
    inputs = mujoco.MjModel._setconst_inputs
    if any(name in inputs or name.startswith("opt.") for name in fields):
        return frozenset(mujoco.MjModel._setconst_outputs)
    return frozenset()


def identity(model: MjModel, varying: Sequence[str] = ()) -> dict[str, object]:
    """MuJoCo's major and minor version; the model's name, sizes, object names and field checksums.

    MuJoCo's patch version is left out, because patch releases give the same numbers.

    Args:
      model: the model.
      varying: model fields set per episode, which are saved with each state instead.
    """
    official, shared = model._official, model._shared
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
    leave_out = {*varying, *derived_fields(varying), "tex_data"}
    found = checksums(model, leave_out)
    return {name: n for name, n in found.items() if not name.endswith(_DRAWN_ONLY)}


@functools.cache
def array_names() -> tuple[str, ...]:
    """Array fields of MjModel, which are the same for all models."""
    return _names_of(empty_model(), np.ndarray)


@functools.cache
def _option_names() -> tuple[str, ...]:
    """Fields of a model's options, as 'opt.gravity'."""
    kinds = np.ndarray | int | float
    return tuple(f"opt.{name}" for name in _names_of(empty_model().opt, kinds))


def _names_of(struct: object, kinds: type | UnionType) -> tuple[str, ...]:
    names = (name for name in dir(struct) if not name.startswith("_"))
    return tuple(name for name in names if isinstance(getattr(struct, name), kinds))
