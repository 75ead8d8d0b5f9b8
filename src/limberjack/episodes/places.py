"""`Place`: the path of a file or folder, or a `remote.Remote`, which a URL gives.

    folder = place_of("s3://bucket/walk")       # place_of("walk") is a path
    path = folder / "dataset.json"
    if exists(path):
        content = read(path)
    with filling(path, folder / "parts") as file:     # a path on this machine
        file.write_bytes(content)

Local files are opened and written as `utils.files` does, which refuses pipes and devices. Files at
a URL are written as `Remote.put` does. Both have `/`, `name`, `suffix`, `mkdir`, `unlink`, `rmdir`
and `rename`.
"""

import contextlib
import io
import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias
from urllib.parse import urlsplit

from limberjack.utils.files import check_regular, open_regular, replacing

if TYPE_CHECKING:
    from limberjack.episodes.remote import Remote

__all__ = [
    "Place",
    "absolute",
    "check_file",
    "exists",
    "filling",
    "local",
    "named",
    "opened",
    "place_of",
    "read",
    "size_of",
]

# A text, because only a URL imports fsspec.
Place: TypeAlias = "Path | Remote"

_UNFINISHED = ".part"  # suffix of unfinished files, so that no reader of Parquet files takes them

# A protocol has two letters at least: C:\walk is a path. `simplecache::s3://...` is a URL, too.
_URL = re.compile(r"([a-z][a-z0-9+.-]+::)*[a-z][a-z0-9+.-]+://", re.IGNORECASE)


def place_of(name: "Path | Remote | str") -> Place:
    """The place with a name.

    Raises:
      ImportError: it is a URL, and fsspec or what its protocol needs is not installed.
      TypeError: it is no name.
      ValueError: it is empty, there is no such protocol, or a `file://` URL names another machine.
    """
    if not isinstance(name, str):
        if not hasattr(name, "exists"):
            raise TypeError(f"{name!r} is no folder; expected a path or a URL")
        return name
    if not name:  # such as a variable of the shell that is not set
        raise ValueError("the name of the folder is empty; expected a path or a URL")
    if not _URL.match(name):
        return Path(name)
    if name.lower().startswith("file://"):
        from urllib.request import url2pathname  # slow to import

        parts = urlsplit(name)
        if parts.netloc.lower() not in ("", "localhost"):
            raise ValueError(
                f"{name} names the machine {parts.netloc!r}; expected an absolute path after "
                "file://, such as file:///data/walk"
            )
        return Path(url2pathname(parts.path))
    from limberjack.episodes.remote import Remote  # which imports fsspec

    return Remote(name)


def absolute(name: "Path | Remote | str") -> Place:
    """The place with a name, from any working directory: a policy may change it."""
    place = place_of(name)
    return place.absolute() if isinstance(place, Path) else place


def local(name: Path | str) -> Path:
    """The path with a name, from any working directory.

    Raises:
      ValueError: it is a URL, of which a `Path` would make a folder `s3:`.
    """
    if isinstance(name, str) and _URL.match(name):
        raise ValueError(
            f"{name} is a URL; expected the path of a folder: only a dataset is written to a URL, "
            "by `limberjack collect`"
        )
    return Path(name).absolute()


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


def read(place: Place) -> bytes:
    """The content of a file.

    Raises:
      OSError, ValueError: see `opened`.
    """
    with opened(place) as file:
        return file.read()


@contextlib.contextmanager
def filling(place: Place, beside: Place) -> Iterator[Path]:
    """A new, empty file on this machine; on a clean exit its content is at the place, whole.

    Args:
      place: of the file, which is replaced if it is there.
      beside: the folder of unfinished files, in the same file system.

    Raises:
      OSError: it cannot be written.
    """
    if isinstance(place, Path):
        assert isinstance(beside, Path)
        with replacing(place, _UNFINISHED, beside) as partial:
            yield partial
        return
    assert not isinstance(beside, Path)
    with tempfile.TemporaryDirectory(prefix="limberjack-") as folder:
        path = Path(folder) / place.name
        path.touch()
        yield path
        place.put(path, beside)
