"""`Place`: the path of a file or folder to read from, or a `remote.Remote`, which a URL gives.

    folder = place_of("s3://bucket/walk")       # place_of("walk") is a path
    path = folder / "dataset.json"
    if exists(path):
        with opened(path) as file:
            content = file.read()

Local files are opened as `utils.files` does, which refuses pipes and devices.
"""

import io
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias
from urllib.parse import urlsplit

from limberjack.utils.files import check_regular, open_regular

if TYPE_CHECKING:
    from limberjack.episodes.remote import Remote

__all__ = ["Place", "check_file", "exists", "named", "opened", "place_of", "size_of"]

# A text, because only a URL imports fsspec.
Place: TypeAlias = "Path | Remote"

# A protocol has two letters at least: C:\walk is a path. `simplecache::s3://...` is a URL, too.
_URL = re.compile(r"([a-z][a-z0-9+.-]+::)*[a-z][a-z0-9+.-]+://", re.IGNORECASE)


def place_of(name: "Path | Remote | str") -> Place:
    """The place with a name.

    Raises:
      ImportError: it is a URL, and fsspec or what its protocol needs is not installed.
      ValueError: there is no such protocol.
    """
    if not isinstance(name, str):
        return name
    if not _URL.match(name):
        return Path(name)
    if name.lower().startswith("file://"):
        from urllib.request import url2pathname  # slow to import

        return Path(url2pathname(urlsplit(name).path))
    from limberjack.episodes.remote import Remote  # which imports fsspec

    return Remote(name)


def exists(place: Place) -> bool:
    """Whether anything is there, a broken link too.

    Raises:
      OSError: the place cannot be reached.
    """
    return os.path.lexists(place) if isinstance(place, Path) else place.exists()


def named(folder: Place, pattern: str) -> "list[Place]":
    """The files in a folder whose names match, in the order of their names.

    Raises:
      OSError: the place cannot be reached.
    """
    if isinstance(folder, Path):
        return [*sorted(folder.glob(pattern))]
    return [*folder.named(pattern)]


def size_of(place: Place) -> int:
    """The bytes of a file.

    Raises:
      OSError: it does not exist, or the place cannot be reached.
    """
    return place.stat().st_size if isinstance(place, Path) else place.size()


def check_file(place: Place) -> None:
    """Checks what can be checked without opening a file.

    Raises:
      OSError: it does not exist, or it is a folder.
      ValueError: it is a pipe, a device or a socket.
    """
    if isinstance(place, Path):
        check_regular(place)


def opened(place: Place) -> io.BufferedIOBase:
    """The file, open for reading; the caller closes it.

    Raises:
      OSError: it cannot be read.
      ValueError: it is a pipe, a device or a socket.
    """
    return open_regular(place) if isinstance(place, Path) else place.open()
