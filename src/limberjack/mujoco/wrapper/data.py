"""`MjData` with dm_control's interface, wrapping the official struct.

    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    physics.data.contact_force(0)
    physics.data.qpos                  # any field of the official struct

Fields are looked up dynamically; none are listed here.
"""

import operator
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.allocating import data_of
from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.mujoco.wrapper.model import MjModel, object_type_number

__all__ = ["MjData", "moving_object"]

# Object types with a velocity, and the sizes that count them.
_COUNT_OF_MOVING = {
    mujoco.mjtObj.mjOBJ_BODY.value: "nbody",
    mujoco.mjtObj.mjOBJ_XBODY.value: "nbody",
    mujoco.mjtObj.mjOBJ_GEOM.value: "ngeom",
    mujoco.mjtObj.mjOBJ_SITE.value: "nsite",
    mujoco.mjtObj.mjOBJ_CAMERA.value: "ncam",
}


def moving_object(model: MjModel, object_id: int | str, object_type: int | str) -> tuple[int, int]:
    """Type and number of an object that has a velocity.

    Raises:
      ValueError: objects of that type have no velocity, or there is no such name or number.
    """
    kind = object_type_number(object_type)
    if kind not in _COUNT_OF_MOVING:
        raise ValueError(
            f"objects of type {object_type!r} have no velocity; expected 'body', 'xbody', "
            "'geom', 'site' or 'camera'"
        )
    if isinstance(object_id, str):
        object_id = model.name2id(object_id, kind)
    number = operator.index(object_id)
    count = getattr(model._official, _COUNT_OF_MOVING[kind])
    if not 0 <= number < count:  # MuJoCo would read out of bounds
        raise ValueError(
            f"object_id is {number}; expected a name, or a number from 0: the model has "
            f"{count} objects of type {object_type!r}"
        )
    return kind, number


class MjData:
    """State and results of a simulation; other fields are those of `mujoco.MjData`."""

    _data: mujoco.MjData
    _model: MjModel

    def __init__(self, model_or_data: "MjModel | mujoco.MjData") -> None:
        if isinstance(model_or_data, MjModel):
            model, data = model_or_data, data_of(model_or_data.structure)
        elif isinstance(model_or_data, mujoco.MjData):
            model, data = MjModel(model_or_data.model), model_or_data
        else:
            raise TypeError(
                f"Expected wrapper.MjModel or mujoco.MjData, got {type(model_or_data).__name__}"
            )
        object.__setattr__(self, "_model", model)
        object.__setattr__(self, "_data", data)

    @property
    def ptr(self) -> mujoco.MjData:
        """The official `mujoco.MjData`."""
        return self._data

    @property
    def model(self) -> MjModel:
        """The model of this data."""
        return self._model

    @property
    def contact(self) -> "mujoco._structs._MjContactList":
        """The contacts found in the last forward pass."""
        return self._data.contact[: self._data.ncon]

    def __getattr__(self, name: str) -> Any:  # fields of the official struct
        if name == "_data":
            raise AttributeError(name)
        return getattr(self._data, name)

    def __setattr__(self, name: str, value: object) -> None:
        setattr(self._data, name, value)

    def __dir__(self) -> list[str]:
        return sorted(set(object.__dir__(self)) | set(dir(self._data)))

    def __getstate__(self) -> mujoco.MjData:
        model = self._model._official
        if model is self._data.model:
            return self._data
        pass_exit_guard()
        # The official data refers to the model it was created from, which has been replaced.
        data = data_of(model)
        mujoco.mj_copyData(data, model, self._data)
        return data

    def __setstate__(self, state: mujoco.MjData) -> None:
        self.__init__(state)

    def __copy__(self) -> "MjData":
        return self._make_copy(share_model=True)

    def __deepcopy__(self, memo: dict[int, object]) -> "MjData":
        return self._make_copy(share_model=False)

    def _make_copy(self, share_model: bool) -> "MjData":
        """A copy of the data, with the same model or a copy of it."""
        new = object.__new__(type(self))
        model = self._model if share_model else self._model.copy()
        object.__setattr__(new, "_model", model)
        object.__setattr__(new, "_data", data_of(model._official, self._data))
        return new

    def copy(self) -> "MjData":
        """A copy of the data with the same model."""
        return self.__copy__()

    def free(self) -> None:
        """Drops the official data; this object must not be used afterwards."""
        object.__setattr__(self, "_data", None)

    def object_velocity(
        self, object_id: int | str, object_type: str | int, local_frame: bool = False
    ) -> np.ndarray:
        """Velocity of an object, (2, 3): linear in m/s, then angular in rad/s.

        Args:
          object_id: number or name.
          object_type: 'body', 'xbody', 'geom', 'site', 'camera', or a `mujoco.mjtObj`.
          local_frame: use the object's frame instead of the world frame.

        Raises:
          ValueError: objects of that type have no velocity, or there is no such name or number.
        """
        kind, number = moving_object(self._model, object_id, object_type)
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(
            self._model._official, self._data, kind, number, velocity, local_frame
        )
        return velocity.reshape(2, 3)[::-1]

    def contact_force(self, contact_id: int) -> np.ndarray:
        """Force and torque of a contact in its frame, (2, 3): normal first, N and N m.

        Raises:
          ValueError: there is no contact with that number.
        """
        if not 0 <= contact_id < self._data.ncon:
            raise ValueError(
                f"`contact_id` must be between 0 and {self._data.ncon - 1} (inclusive), got: "
                f"{contact_id}."
            )
        pass_exit_guard()
        model, data = self._model._official, self._data
        # The parts of a step's second half on which contact forces depend.
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        wrench = np.empty(6)
        mujoco.mj_contactForce(model, data, contact_id, wrench)
        return wrench.reshape(2, 3)
