"""Reading resource files, by the names that dm_control gave to these four functions.

    xml = GetResource("model.xml")

A resource is a plain file: a name is its path. New code does better with `pathlib`.
"""

import os
from collections.abc import Iterator
from typing import IO, Any

__all__ = ["GetResource", "GetResourceAsFile", "GetResourceFilename", "WalkResources"]


# Bytes or text, as the mode says.
def GetResource(name: str | os.PathLike[str], mode: str = "rb") -> Any:  # noqa: N802
    """The whole content of a file: bytes, or text if `mode` is 'r'."""
    with GetResourceAsFile(name, mode) as file:
        return file.read()


def GetResourceFilename(name: str, mode: str = "rb") -> str:  # noqa: N802
    """The path of a resource, which is its name; `mode` changes nothing."""
    return name


# As above, and whatever else `open` takes.
def GetResourceAsFile(  # noqa: N802
    name: str | os.PathLike[str], mode: str = "r", **options: Any
) -> IO[Any]:
    """The open file, to be closed by the caller; `mode` and `options` as for `open`.

    Text is UTF-8 on every platform, unless `encoding` says otherwise.
    """
    if "b" not in mode:
        options.setdefault("encoding", "utf-8")
    return open(name, mode, **options)


def WalkResources(path: str) -> Iterator[tuple[str, list[str], list[str]]]:  # noqa: N802
    """Directories below `path`, each with its sub-directories and files, as `os.walk`."""
    return os.walk(path)
