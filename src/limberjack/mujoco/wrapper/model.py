"""`MjModel` with dm_control's interface, wrapping the official struct.

    physics.model.name2id("torso", "body")
    physics.model.opt.timestep         # any field of the official struct

Fields are looked up dynamically, so fields of newer MuJoCo versions need no change here.
Simulations in a process may share a compiled model: see `sharing`.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from limberjack.mujoco.allocating import allocating, copy_of
from limberjack.mujoco.exit_guard import pass_exit_guard
from limberjack.mujoco.wrapper import util
from limberjack.mujoco.wrapper.integer_fields import (
    FIXED,
    NO_TEXTURES,
    checked_field,
    empty_model,
    fixed_field,
    is_checked,
    is_structure,
)
from limberjack.mujoco.wrapper.sharing import CopyOnWrite, Mjcf, SharedModel, last_loaded
from limberjack.mujoco.wrapper.textures import without_textures
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "Error",
    "MjModel",
    "empty_model",
    "fixed_field",
    "is_checked",
    "is_structure",
    "object_type_number",
    "save_last_parsed_model_to_xml",
]

# Prefixes of fields copied to OpenGL; once user code has them, each picture checks for changes.
_UPLOADED = ("hfield", "tex", "mesh")

_NOT_LAST = (
    "Only the model that was most recently loaded from an XML file or string can be saved to an "
    "XML file."
)


class Error(ValueError):
    """The model has no object with this name, or there is no such type."""


class MjModel(CopyOnWrite):
    """A compiled model; fields not defined here are those of `mujoco.MjModel`.

    Structural fields (parents, addresses, counts) are read-only, and writes of types and references
    are checked: MuJoCo does not check them again and would read out of bounds; see
    `integer_fields`. `ptr` is MuJoCo's own struct, without this protection.
    """

    def __getattr__(self, name: str) -> Any:  # fields of the official struct
        if name in ("_official", "_shared"):  # not yet initialised, as while copying
            raise AttributeError(name)
        if is_checked(name):
            return checked_field(self.ptr if name.startswith(_UPLOADED) else self.own(), name)
        if is_structure(name):
            return fixed_field(self._official, name)
        if not name.startswith(_UPLOADED):
            return self._field(name)
        field = getattr(self.ptr, name)
        if name == "tex_data" and self._official.ntex and not field.size:
            raise ValueError(NO_TEXTURES)
        return field

    def __setattr__(self, name: str, value: object) -> None:
        if is_checked(name):
            getattr(self, name)[...] = value
            return
        if is_structure(name):
            raise ValueError(FIXED.format(name))
        setattr(self.ptr, name, value)

    def __dir__(self) -> list[str]:
        return sorted(set(object.__dir__(self)) | set(dir(self._official)))

    def __getstate__(self) -> mujoco.MjModel:
        return self._official

    def __setstate__(self, state: mujoco.MjModel) -> None:
        self.__init__(state)

    def __copy__(self) -> "MjModel":
        return type(self)(self._shared or copy_of(self._official), self._mjcf)

    def without_textures(self) -> "MjModel":
        """An equivalent model for simulation that takes a hundredth of the memory."""
        if self._shared is not None:
            return MjModel(SharedModel(self._shared.light))
        light = without_textures(self._official)
        return MjModel(copy_of(light) if light is self._official else light)

    def copy(self) -> "MjModel":
        """A copy; changes to it do not affect this model."""
        return self.__copy__()

    def __deepcopy__(self, memo: dict[int, object]) -> "MjModel":
        return self.__copy__()

    @classmethod
    def from_xml_string(
        cls, xml_string: str | bytes, assets: dict[str, bytes] | None = None
    ) -> "MjModel":
        """Compiles MJCF or URDF text.

        Args:
          xml_string: the model's XML.
          assets: contents of the files it refers to, by name.

        Raises:
          ValueError: MuJoCo's error message about the model.
          MemoryError: there is no memory for it.
        """
        mjcf = xml_string, assets or {}
        model = cls(_parsed(mjcf), mjcf)
        last_loaded.set(model)
        return model

    @classmethod
    def from_byte_string(cls, byte_string: bytes) -> "MjModel":
        """Reads a model in binary format (MJB), as from `to_bytes`."""
        pass_exit_guard()
        name = "model.mjb"
        with allocating("a model in binary format", len(byte_string)):
            return cls(mujoco.MjModel.from_binary_path(name, {name: byte_string}))

    @classmethod
    def from_xml_path(cls, xml_path: str) -> "MjModel":
        """Compiles an MJCF or URDF file."""
        pass_exit_guard()
        with allocating("a model compiled from its files", _size_of(xml_path)):
            model = cls(mujoco.MjModel.from_xml_path(str(xml_path)))
        last_loaded.set(model)
        return model

    @classmethod
    def from_binary_path(cls, binary_path: str) -> "MjModel":
        """Reads a file in binary format (MJB), as from `save_binary`."""
        pass_exit_guard()
        with allocating("a model in binary format", _size_of(binary_path)):
            return cls(mujoco.MjModel.from_binary_path(str(binary_path)))

    def save_binary(self, binary_path: str) -> None:
        """Writes the model to a file in MuJoCo's binary format (MJB)."""
        pass_exit_guard()
        mujoco.mj_saveModel(self._official, str(binary_path), None)

    def to_bytes(self) -> bytes:
        """The model in MuJoCo's binary format (MJB)."""
        pass_exit_guard()
        buffer = np.zeros(mujoco.mj_sizeModel(self._official), np.uint8)
        mujoco.mj_saveModel(self._official, None, buffer)
        return buffer.tobytes()

    def free(self) -> None:
        """Drops the official model; this object must not be used afterwards."""
        object.__setattr__(self, "_shared", None)
        object.__setattr__(self, "_official", None)

    def name2id(self, name: str, object_type: str | int) -> int:
        """Number of the object called `name`.

        Args:
          name: the object's name.
          object_type: 'body', 'geom', ... or a `mujoco.mjtObj`.

        Raises:
          Error: there is no such type, or no object with that name.
          TypeError: the name is not a text; MuJoCo would crash at None.
        """
        if not isinstance(name, str | bytes):
            raise TypeError(f"name is {name!r}; expected the name of an object as a string")
        kind = object_type_number(object_type)
        index = mujoco.mj_name2id(self._official, kind, name)
        if index == -1:
            names = self._names(kind)
            word = mujoco.mju_type2Str(kind)
            raise Error(
                f"Object of type {word!r} with name {name!r} does not exist."
                f"{did_you_mean(name, names)} Names: {', '.join(names) or 'none'}."
            )
        return index

    def id2name(self, object_id: int, object_type: str | int) -> str:
        """Name of an object; empty if it is unnamed or does not exist.

        Raises:
          Error: there is no such type.
        """
        return mujoco.mj_id2name(self._official, object_type_number(object_type), object_id) or ""

    def _names(self, kind: int) -> list[str]:
        """Names of the named objects of a type, in order."""
        names: list[str] = []
        while (name := mujoco.mj_id2name(self._official, kind, len(names))) is not None:
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
        return self._official.names.split(b"\0", 1)[0].decode()


def save_last_parsed_model_to_xml(xml_path: str, check_model: MjModel | None = None) -> None:
    """Writes the model most recently loaded from XML, with its changes since, to an MJCF file.

    Loading it again from the cache of compiled models counts too. MuJoCo writes fewer digits than
    it stores, so many fields differ in the last bits after recompiling.

    Args:
      xml_path: the file to write.
      check_model: if given, must be the most recently loaded model.

    Raises:
      ValueError: another model has been loaded since, or none yet.
    """
    last = last_loaded
    if last.model is None or (check_model is not None and not last.is_of(check_model)):
        raise ValueError(_NOT_LAST)
    if not last.is_parsed and last.mjcf is not None:  # MuJoCo saves only what it has parsed last
        _parsed(last.mjcf)
        last.is_parsed = True
    try:
        mujoco.mj_saveLastXML(str(xml_path), last.model)
    except mujoco.FatalError as error:  # MuJoCo itself has parsed another one
        raise ValueError(_NOT_LAST) from error


def _parsed(mjcf: Mjcf) -> mujoco.MjModel:
    """The model of an MJCF or URDF text, which becomes the one that MuJoCo can save as XML."""
    pass_exit_guard()
    text, assets = util.to_native_string(mjcf[0]), mjcf[1]
    with allocating("a model compiled from its files", len(text) + sum(map(len, assets.values()))):
        return mujoco.MjModel.from_xml_string(text, assets)


def object_type_number(object_type: str | int) -> int:
    """An object type's number from its name or number."""
    pass_exit_guard()
    if not isinstance(object_type, str):
        return int(object_type)
    kind = int(mujoco.mju_str2Type(object_type))
    if not kind:
        raise Error(f"{object_type!r} is not a valid object type name, such as 'body' or 'geom'.")
    return kind


def _size_of(file: str) -> int:
    """Size of a file in bytes; 0 if it does not exist, which MuJoCo reports."""
    path = Path(file)
    return path.stat().st_size if path.exists() else 0


def _disable_bit(flag: str | int) -> int:
    """The bit of a disable flag, given by name or number."""
    if not isinstance(flag, str):
        return mujoco.mjtDisableBit(int(flag)).value
    bits = {
        name.removeprefix("mjDSBL_").lower(): bit.value
        for name, bit in mujoco.mjtDisableBit.__members__.items()
        if name.startswith("mjDSBL_")
    }
    if flag.lower() not in bits:
        valid = ", ".join(bits)
        raise ValueError(f"'{flag}' is not a valid flag name. Valid names: {valid}")
    return bits[flag.lower()]
