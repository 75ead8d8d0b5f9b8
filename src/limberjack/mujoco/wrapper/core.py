"""`MjModel` and `MjData` as dm_control's programs know them, around the official ones.

    physics.model.name2id("torso", "body")
    physics.model.opt.timestep         # any field of the official structs
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)

Fields are looked up when they are asked for; nothing here lists them, so a new MuJoCo's fields
are simply there. A compiled model may be shared by many simulations of the process: the first
access through which somebody could change it gives this `MjModel` a copy of its own. Code inside
the package that only reads uses `model._model` and leaves it shared.
"""

import contextlib
import copy
import time
from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.wrapper import util
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "Error",
    "MjData",
    "MjModel",
    "SharedModel",
    "callback_context",
    "enable_timer",
    "set_callback",
]

# What cannot be changed in place and so may be handed out of a shared model.
_IMMUTABLE = (int, float, str, bytes)


class Error(ValueError):
    """A name or type that the model does not have."""


class SharedModel:
    """A compiled model that several simulations use and none may change."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self._passive: mujoco.MjModel | None = None

    @property
    def passive(self) -> mujoco.MjModel:
        """The model with actuation disabled, for the forward pass after a reset."""
        # A second model, because switching the flag of a shared one would reach other threads.
        if self._passive is None:
            passive = copy.copy(self.model)
            passive.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION.value
            self._passive = passive
        return self._passive


class MjModel:
    """A compiled model; fields not defined here are those of `mujoco.MjModel`."""

    # Any: the official struct's fields, which are not listed here.
    _model: Any
    _shared: SharedModel | None  # while it is shared
    _origin: SharedModel | None  # kept for those who share it still

    def __init__(self, model_ptr: "mujoco.MjModel | SharedModel") -> None:
        shared = model_ptr if isinstance(model_ptr, SharedModel) else None
        object.__setattr__(self, "_shared", shared)
        object.__setattr__(self, "_origin", shared)
        object.__setattr__(self, "_model", model_ptr if shared is None else shared.model)

    @property
    def ptr(self) -> mujoco.MjModel:
        """The official `mujoco.MjModel`, this wrapper's own."""
        if self._shared is not None:
            self.make_own()
        return self._model

    def make_own(self) -> None:
        """Takes a copy of a shared model, so that changes reach no other simulation."""
        if self._shared is not None:
            object.__setattr__(self, "_model", copy.copy(self._shared.model))
            object.__setattr__(self, "_shared", None)

    def __getattr__(self, name: str) -> Any:
        if name == "_model":  # a half-made object, as in copying: do not look it up for ever
            raise AttributeError(name)
        value = getattr(self._model, name)
        if self._shared is None or isinstance(value, _IMMUTABLE):
            return value
        return getattr(self.ptr, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.ptr, name, value)

    def __dir__(self) -> list[str]:
        return sorted(set(object.__dir__(self)) | set(dir(self._model)))

    def __getstate__(self) -> mujoco.MjModel:
        return self._model

    def __setstate__(self, state: mujoco.MjModel) -> None:
        self.__init__(state)

    def __copy__(self) -> "MjModel":
        return type(self)(self._shared or copy.copy(self._model))

    def copy(self) -> "MjModel":
        """A model whose changes do not reach this one."""
        return self.__copy__()

    def __deepcopy__(self, memo: dict) -> "MjModel":
        return self.__copy__()

    @classmethod
    def from_xml_string(cls, xml_string: str | bytes, assets: dict | None = None) -> "MjModel":
        """Compiles MJCF or URDF text.

        Args:
          xml_string: the model's XML.
          assets: contents of the files that it names, by name.

        Raises:
          ValueError: MuJoCo's message on what is wrong with the model.
        """
        text = util.to_native_string(xml_string)
        return cls(mujoco.MjModel.from_xml_string(text, assets or {}))

    @classmethod
    def from_byte_string(cls, byte_string: bytes) -> "MjModel":
        """Reads a model in binary form, as made by `to_bytes`."""
        name = "model.mjb"
        return cls(mujoco.MjModel.from_binary_path(name, {name: byte_string}))

    @classmethod
    def from_xml_path(cls, xml_path: str) -> "MjModel":
        """Compiles an MJCF or URDF file."""
        return cls(mujoco.MjModel.from_xml_path(str(xml_path)))

    @classmethod
    def from_binary_path(cls, binary_path: str) -> "MjModel":
        """Reads a file in binary form, as made by `save_binary`."""
        return cls(mujoco.MjModel.from_binary_path(str(binary_path)))

    def save_binary(self, binary_path: str) -> None:
        """Writes the model to a file in MuJoCo's binary form."""
        mujoco.mj_saveModel(self._model, str(binary_path), None)

    def to_bytes(self) -> bytes:
        """The model in MuJoCo's binary form."""
        buffer = np.zeros(mujoco.mj_sizeModel(self._model), np.uint8)
        mujoco.mj_saveModel(self._model, None, buffer)
        return buffer.tobytes()

    def free(self) -> None:
        """Drops the official model; this object must not be used afterwards."""
        object.__setattr__(self, "_shared", None)
        object.__setattr__(self, "_model", None)

    def name2id(self, name: str, object_type: str | int) -> int:
        """Number of the object called `name`.

        Args:
          name: the object's name.
          object_type: 'body', 'geom', ... or a `mujoco.mjtObj`.

        Raises:
          Error: no such type or no object of that name.
        """
        kind = _object_type(object_type)
        index = mujoco.mj_name2id(self._model, kind, name)
        if index == -1:
            names = self._names(kind)
            word = mujoco.mju_type2Str(kind)
            raise Error(
                f"Object of type {word!r} with name {name!r} does not exist."
                f"{did_you_mean(name, names)} Names: {', '.join(names) or 'none'}."
            )
        return index

    def id2name(self, object_id: int, object_type: str | int) -> str:
        """Name of an object; empty if it has none or does not exist.

        Raises:
          Error: no such type.
        """
        return mujoco.mj_id2name(self._model, _object_type(object_type), object_id) or ""

    def _names(self, kind: int) -> list[str]:
        """Names of the objects of a type, in their order."""
        names: list[str] = []
        while (name := mujoco.mj_id2name(self._model, kind, len(names))) is not None:
            names.append(name)
        return [name for name in names if name]

    @contextlib.contextmanager
    def disable(self, *flags: str | int) -> Iterator[None]:
        """Disables parts of the simulation within the context.

        Args:
          *flags: names ('gravity', 'contact', ...) or `mujoco.mjtDisableBit` values.

        Raises:
          ValueError: an unknown name or value.
        """
        bits = 0
        for flag in flags:
            bits |= _disable_bit(flag)
        opt = self.ptr.opt
        before = opt.disableflags
        try:
            opt.disableflags = before | bits
            yield
        finally:
            opt.disableflags = before

    @property
    def name(self) -> str:
        """The model's name."""
        return self._model.names.split(b"\0", 1)[0].decode()


class MjData:
    """A simulation's state and results; other fields are those of `mujoco.MjData`."""

    # Any: the official struct's fields, which are not listed here.
    _data: Any
    _model: MjModel

    def __init__(self, model_or_data: "MjModel | mujoco.MjData") -> None:
        if isinstance(model_or_data, MjModel):
            model, data = model_or_data, mujoco.MjData(model_or_data._model)
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
        """The model that this data belongs to."""
        return self._model

    @property
    def contact(self) -> Any:
        """The contacts found at the last forward pass."""
        return self._data.contact[: self._data.ncon]

    def __getattr__(self, name: str) -> Any:
        if name == "_data":
            raise AttributeError(name)
        return getattr(self._data, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._data, name, value)

    def __dir__(self) -> list[str]:
        return sorted(set(object.__dir__(self)) | set(dir(self._data)))

    def __getstate__(self) -> mujoco.MjData:
        model = self._model._model
        if model is self._data.model:
            return self._data
        # The official data carries the model it was made of, which is not ours any more.
        data = mujoco.MjData(model)
        mujoco.mj_copyData(data, model, self._data)
        return data

    def __setstate__(self, state: mujoco.MjData) -> None:
        self.__init__(state)

    def __copy__(self) -> "MjData":
        return self._make_copy(share_model=True)

    def __deepcopy__(self, memo: dict) -> "MjData":
        return self._make_copy(share_model=False)

    def _make_copy(self, share_model: bool) -> "MjData":
        """A copy of the data, with the same model or a copy of it."""
        new = object.__new__(type(self))
        model = self._model if share_model else self._model.copy()
        object.__setattr__(new, "_model", model)
        object.__setattr__(new, "_data", copy.copy(self._data))
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
          object_type: 'body', 'geom', ... or a `mujoco.mjtObj`.
          local_frame: in the object's frame instead of the world's.

        Raises:
          Error: no such type or name.
        """
        kind = _object_type(object_type)
        if isinstance(object_id, str):
            object_id = self._model.name2id(object_id, kind)
        velocity = np.empty(6)
        mujoco.mj_objectVelocity(
            self._model._model, self._data, kind, object_id, velocity, local_frame
        )
        return velocity.reshape(2, 3)[::-1]

    def contact_force(self, contact_id: int) -> np.ndarray:
        """Force and torque of a contact in its frame, (2, 3): normal first, N and N m.

        Raises:
          ValueError: there is no contact of that number.
        """
        if not 0 <= contact_id < self._data.ncon:
            raise ValueError(
                f"`contact_id` must be between 0 and {self._data.ncon - 1} (inclusive), got: "
                f"{contact_id}."
            )
        model, data = self._model._model, self._data
        # The part of a step's second half that contact forces depend on.
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        mujoco.mj_fwdConstraint(model, data)
        wrench = np.empty(6)
        mujoco.mj_contactForce(model, data, contact_id, wrench)
        return wrench.reshape(2, 3)


def set_callback(name: str, new_callback: Any = None) -> None:
    """Installs a MuJoCo callback: a callable, a C function or its address; None removes it."""
    getattr(mujoco, f"set_{name}")(new_callback)


@contextlib.contextmanager
def callback_context(name: str, new_callback: Any = None) -> Iterator[None]:
    """Installs a MuJoCo callback within the context."""
    before = getattr(mujoco, f"get_{name}")()
    set_callback(name, new_callback)
    try:
        yield
    finally:
        set_callback(name, before)


def enable_timer(enabled: bool = True) -> None:
    """Lets MuJoCo time its stages with the wall clock."""
    timer: Callable[[], float] | None = time.time if enabled else None
    set_callback("mjcb_time", timer)


def _object_type(object_type: str | int) -> int:
    """An object type's number from its name or number."""
    if not isinstance(object_type, str):
        return int(object_type)
    kind = int(mujoco.mju_str2Type(object_type))
    if not kind:
        raise Error(f"{object_type!r} is not a valid object type name, such as 'body' or 'geom'.")
    return kind


def _disable_bit(flag: str | int) -> int:
    """The bit of a disable flag, given by name or number."""
    if not isinstance(flag, str):
        return mujoco.mjtDisableBit(int(flag)).value
    bits = {
        name.removeprefix("mjDSBL_").lower(): bit.value
        for name, bit in mujoco.mjtDisableBit.__members__.items()
        if name.startswith("mjDSBL_")
    }
    if flag not in bits:
        valid = ", ".join(bits)
        raise ValueError(f"'{flag}' is not a valid flag name. Valid names: {valid}")
    return bits[flag]
