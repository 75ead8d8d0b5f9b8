"""Sizes of GIFs, read from their headers."""

import struct
from pathlib import Path

__all__ = ["size_of"]


def size_of(path: Path) -> tuple[int, int]:
    """Height and width of a GIF, pixels."""
    header = path.read_bytes()[:10]
    assert header.startswith(b"GIF8")
    width, height = struct.unpack("<2H", header[6:])
    return height, width
