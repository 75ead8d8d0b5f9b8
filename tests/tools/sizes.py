"""Sizes of files of pictures."""

from pathlib import Path

from PIL import Image

__all__ = ["size_of"]


def size_of(path: Path) -> tuple[int, int]:
    """Height and width, pixels."""
    with Image.open(path) as picture:
        return picture.height, picture.width
