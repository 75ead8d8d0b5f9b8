"""Reads resource files; these four function names are dm_control's.

    xml = GetResource("model.xml")

A resource is a plain file, named by its path. New code should use `pathlib`.
"""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from limberjack.utils.files import check_regular

__all__ = ["GetResource", "GetResourceAsFile", "GetResourceFilename", "WalkResources"]


def GetResource(  # noqa: N802
    name: str | os.PathLike[str], mode: str = "rb"
) -> str | bytes:
    """The whole content of a file: bytes, or text if `mode` is 'r'."""
    with GetResourceAsFile(name, mode) as file:
        return file.read()


def GetResourceFilename(name: str, mode: str = "rb") -> str:  # noqa: N802
    """The path of a resource, which is its name; `mode` is ignored."""
    return name


# Any: keyword arguments of `open`, and its result, whose type depends on the mode.
def GetResourceAsFile(  # noqa: N802
    name: str | os.PathLike[str], mode: str = "r", **options: Any
) -> IO[Any]:
    """The open file, which the caller must close; `mode` and `options` are those of `open`.

    Text defaults to UTF-8 on every platform. In a mode that reads, anything but a regular file is
    refused with ValueError, because reading it may never end.
    """
    if not set(mode) & set("wax+"):
        check_regular(Path(name))
    if "b" not in mode:
        options.setdefault("encoding", "utf-8")
    return open(name, mode, **options)


def WalkResources(path: str) -> Iterator[tuple[str, list[str], list[str]]]:  # noqa: N802
    """Directories below `path`, each with its subdirectories and files, as from `os.walk`."""
    return os.walk(path)
