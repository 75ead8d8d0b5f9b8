"""`RowsData` and `RowsModel`: the types of `physics.data` and `physics.model` in a batch.

    physics.data.qpos          # (num_envs, nq), live
    physics.model.body_mass    # (num_envs, nbody) if rows have their own, else (nbody,), read-only

They have the fields of the official structs, with one row per simulation. They cannot be stepped.
"""

import functools
from typing import Any, NoReturn

import mujoco
import numpy as np

from limberjack.mujoco.allocating import copy_of, data_of
from limberjack.mujoco.read_only import ReadOnlyStruct
from limberjack.mujoco.simulation import Fields
from limberjack.mujoco.wrapper.core import MjModel
from limberjack.mujoco.wrapper.data import moving_object
from limberjack.utils import arrays

__all__ = ["RowsData", "RowsModel"]

# Fields with the position and the frame of an object, and the one with its body, by object type.
_POSES = {
    mujoco.mjtObj.mjOBJ_BODY.value: ("xipos", "ximat", None),
    mujoco.mjtObj.mjOBJ_XBODY.value: ("xpos", "xmat", None),
    mujoco.mjtObj.mjOBJ_GEOM.value: ("geom_xpos", "geom_xmat", "geom_bodyid"),
    mujoco.mjtObj.mjOBJ_SITE.value: ("site_xpos", "site_xmat", "site_bodyid"),
    mujoco.mjtObj.mjOBJ_CAMERA.value: ("cam_xpos", "cam_xmat", "cam_bodyid"),
}


class RowsData:
    """The fields of a batch's MjData."""

    def __init__(self, fields: Fields) -> None:
        vars(self)["_fields"] = fields
        vars(self)["model"] = RowsModel(fields)

    @property
    def _data(self) -> "RowsData":
        """This object, in place of the official data that a single simulation's wrapper has."""
        return self

    @functools.cached_property
    def _one(self) -> mujoco.MjData:
        """Scratch data for MuJoCo's functions of single simulations."""
        return data_of(self.model._official)

    def __getattr__(self, name: str) -> Any:  # fields of the official struct
        if name == "_fields":  # not yet set, as while copying: avoids infinite recursion
            raise AttributeError(name)
        try:
            field = self._fields.data_field(name)[0]
        except AttributeError:
            raise AttributeError(
                f"the data of a batch has no {name!r}; it has the arrays of mujoco.MjData, with "
                "one row per simulation"
            ) from None
        if callable(field):
            raise AttributeError(f"a batch has no data.{name}(...): use the methods of physics")
        if hasattr(field, "shape"):
            vars(self)[name] = field  # cached: the array stays the same while the batch lives
        return field

    def __setattr__(self, name: str, value: object) -> None:
        self._fields.data_field(name)[0][...] = value

    def object_velocity(
        self, object_id: int | str, object_type: str | int, local_frame: bool = False
    ) -> np.ndarray:
        """Velocity of an object, (..., 2, 3): linear in m/s, then angular in rad/s.

        The arguments and errors are those of `MjData.object_velocity`.
        """
        kind, number = moving_object(self.model, object_id, object_type)
        model: mujoco.MjModel = self.model._official
        position, frame, owner = _POSES[kind]
        body = number if owner is None else getattr(model, owner)[number]
        reads = {"cvel": body, "subtree_com": model.body_rootid[body]}
        reads |= {position: number, frame: number}
        values = [getattr(self, name)[..., index, :] for name, index in reads.items()]
        if not isinstance(values[0], np.ndarray):  # on a device: MuJoCo's functions cannot read it
            return _velocity(*values, local_frame=local_frame)
        # Not `_velocity`, which rounds differently where compilers fuse operations.
        places = [getattr(self._one, name)[index] for name, index in reads.items()]
        velocity = np.empty((*values[0].shape[:-1], 6))
        for row in np.ndindex(velocity.shape[:-1]):
            for place, value in zip(places, values, strict=True):
                place[...] = value[row]
            mujoco.mj_objectVelocity(model, self._one, kind, number, velocity[row], local_frame)
        return velocity.reshape(*velocity.shape[:-1], 2, 3)[..., ::-1, :]


def _velocity(
    cvel: np.ndarray, com: np.ndarray, position: np.ndarray, frame: np.ndarray, local_frame: bool
) -> np.ndarray:
    """`mj_objectVelocity` by array operations, (..., 2, 3): linear, then angular."""
    angular, linear = cvel[..., :3], cvel[..., 3:]
    linear = linear - np.cross(position - com, angular)
    velocity = np.stack((linear, angular), axis=-2)
    return arrays.to_frame(velocity, frame) if local_frame else velocity


class RowsModel(MjModel):
    """The fields of a batch's MjModel; per-row fields have a leading batch axis."""

    def __init__(self, fields: Fields) -> None:
        object.__setattr__(self, "_fields", fields)
        object.__setattr__(self, "_official", fields.model._official)
        object.__setattr__(self, "_shared", fields.model._shared)

    def __getattr__(self, name: str) -> Any:  # fields of the official struct
        if name in ("_fields", "_official", "_shared"):  # not yet initialised
            raise AttributeError(name)
        field = self._fields.model_field(name)[0]
        if hasattr(field, "shape") or isinstance(field, int | float | str | bytes):
            return field
        if callable(field):
            raise AttributeError(f"a batch has no model.{name}(...): use physics.named.model")
        return ReadOnlyStruct(field, name, self._own_parts(name))

    def _own_parts(self, struct: str) -> dict[str, np.ndarray]:
        """Per-row fields of a struct of the model, such as the gravity of `opt`."""
        prefix, own = f"{struct}.", getattr(self._fields, "own_fields", ())
        return {
            name.removeprefix(prefix): self._fields.model_field(name)[0]
            for name in own
            if name.startswith(prefix)
        }

    def __setattr__(self, name: str, value: object) -> None:
        field = self._fields.model_field(name)[0]
        if not hasattr(field, "shape"):
            raise ValueError(
                f"{name} of the model is shared by all rows and read-only: change it before "
                "creating the batch"
            )
        field[...] = value

    @property
    def ptr(self) -> mujoco.MjModel:
        """A copy of the official model shared by the rows; changes to it affect no row."""
        return copy_of(self._official)

    def disable(self, *flags: str | int) -> NoReturn:
        """Raises TypeError: the rows share their model's options."""
        raise TypeError(
            f"the model of a batch cannot disable {', '.join(map(str, flags))} for a while: set "
            "opt.disableflags of the environment's model before creating the batch, or use a "
            "single environment"
        )

    def __reduce__(self) -> tuple[type[MjModel], tuple[mujoco.MjModel]]:
        return MjModel, (self._official,)

    def __copy__(self) -> MjModel:
        return self._fields.model.copy()
