"""Conversions between text and bytes, and `get_mjlib`."""

from types import ModuleType

import mujoco

__all__ = ["get_mjlib", "to_binary_string", "to_native_string"]


def to_binary_string(text: str | bytes) -> bytes:
    """The text as UTF-8 bytes."""
    return text if isinstance(text, bytes) else text.encode()


def to_native_string(text: str | bytes) -> str:
    """The bytes as text."""
    return text.decode() if isinstance(text, bytes) else text


def get_mjlib() -> ModuleType:
    """The official `mujoco` module, which has all functions of the library."""
    return mujoco
