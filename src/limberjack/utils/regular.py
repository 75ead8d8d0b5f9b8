"""Input files that a user names: only regular files are read, so that reading them ends.

    content = read_regular(Path("walk.zip"))

A pipe may never have content and a device may never end; both are refused before anything is read.
Links to regular files are followed.
"""

import errno
import io
import os
import stat
from pathlib import Path

__all__ = ["check_regular", "open_regular", "read_regular"]

# Against waiting at a pipe that takes the file's place meanwhile; 0 where the system lacks it.
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)
_BYTES = getattr(os, "O_BINARY", 0)


def check_regular(path: Path) -> None:
    """Checks the file at `path` without opening it.

    Raises:
      OSError: there is none, or it is a folder.
      ValueError: it is a pipe, a device or a socket.
    """
    _check_kind(path, os.stat(path).st_mode)


def open_regular(path: Path) -> io.BufferedReader:
    """The file at `path`, open for reading; the caller closes it.

    Raises:
      OSError: it cannot be read.
      ValueError: it is a pipe, a device or a socket.
    """
    check_regular(path)  # first, because opening a device may already have an effect
    file = os.fdopen(os.open(path, os.O_RDONLY | _NO_WAIT | _BYTES), "rb")
    try:
        _check_kind(path, os.fstat(file.fileno()).st_mode)
    except BaseException:
        file.close()
        raise
    return file


def read_regular(path: Path) -> bytes:
    """The content of the file at `path`.

    Raises:
      OSError: it cannot be read.
      ValueError: it is a pipe, a device or a socket.
    """
    with open_regular(path) as file:
        return file.read()


def _check_kind(path: Path, mode: int) -> None:
    if stat.S_ISREG(mode):
        return
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise ValueError(
        f"{path} is {_kind(mode)}; expected a regular file: write its content into one, and name "
        "that"
    )


def _kind(mode: int) -> str:
    if stat.S_ISFIFO(mode):
        return "a pipe"
    return "a socket" if stat.S_ISSOCK(mode) else "a device"
