"""Model fields that rows on a device may have their own values of.

check(("body_pos", "hfield_data"))     # ValueError: MuJoCo Warp shares hfield_data
batched(("body_pos", "site_rgba"))            # ("body_pos",)
"""

import dataclasses
import functools
from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from limberjack.gpu.backend import mujoco_warp, warp
from limberjack.mujoco.simulation import read_field

__all__ = ["batched", "check", "expand_option", "shared_elements", "values"]

_OPTION = "opt."
_READ_ONLY_BY_TASKS = ("_rgba", "site_size")  # suffixes of fields that no time step reads
_OF_SIZE = (mujoco.mjtSensor.mjSENS_INSIDESITE, mujoco.mjtSensor.mjSENS_TOUCH)


def check(names: Sequence[str]) -> None:
    """Raises ValueError unless rows on a device may have their own values of these fields.

    They may if MuJoCo Warp can vary the field, or if no time step reads it; but see
    `shared_elements`.
    """
    for name in names:
        if name in _in_model() or name in _in_options() or name.endswith(_READ_ONLY_BY_TASKS):
            continue
        raise ValueError(
            f"each episode has its own {name}, which MuJoCo Warp shares between all rows: use the "
            "CPU, limberjack.gym.load_vector"
        )


def batched(names: Iterable[str]) -> tuple[str, ...]:
    """The fields of which MuJoCo Warp's model can hold one value per row."""
    return tuple(sorted(name for name in names if name in _in_model()))


def values(model: mujoco.MjModel, name: str) -> np.ndarray:
    """The model's values of a field, or of an option as 'opt.gravity'."""
    return np.asarray(read_field(model, name))


def expand_option(options: "mujoco_warp.Option", name: str, num_envs: int) -> "warp.array":
    """Gives the options of MuJoCo Warp's model an array with one value for each row."""
    field = name.removeprefix(_OPTION)
    shared = getattr(options, field)
    array = warp.array(np.repeat(shared.numpy(), num_envs, axis=0), dtype=shared.dtype)
    array._is_batched = True
    setattr(options, field, array)
    return array


@functools.cache
def _in_model() -> frozenset[str]:
    return frozenset(_with_rows(mujoco_warp.Model))


@functools.cache
def _in_options() -> frozenset[str]:
    return frozenset(_OPTION + name for name in _with_rows(mujoco_warp.Option))


def _with_rows(struct: type) -> Iterable[str]:
    """Names of the arrays that may have a leading axis of rows."""
    for field in dataclasses.fields(struct):
        if getattr(field.type, "shape", ())[:1] == ("*",):
            yield field.name


def shared_elements(model: mujoco.MjModel, name: str) -> np.ndarray:
    """Mask of the elements that all rows must share, in a field that may otherwise differ.

    These are the sizes of sites within which a sensor measures.
    """
    shared = np.zeros(np.shape(values(model, name)), bool)
    if name == "site_size":
        shared[model.sensor_objid[np.isin(model.sensor_type, _OF_SIZE)]] = True
    return shared
