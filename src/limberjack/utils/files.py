"""Files: written whole or not at all, read only if they are regular, and locked by one process.

    with Hold(Path("out")), replacing(Path("out/result.json")) as partial:
        partial.write_text(text)

Every file of the package is written here, under a new name: `Partial` creates it exclusively, under
a name with random letters, so that nobody can plant a file or a link there and threads and
processes never share one. It has the permissions that a plain `open` gives. `appending` opens a
file that only grows.

`replacing` protects against failures, interrupts and power loss: a file is put in place only after
its content has reached the disk. `Hold` is advisory: it excludes only processes that also use it.

Of the files that a user names, only regular ones are read, so that reading them ends: a pipe may
never have content and a device may never end, and both are refused before anything is read. Links
to regular files are followed.
"""

import contextlib
import errno
import io
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

__all__ = [
    "Hold",
    "Partial",
    "appending",
    "check_regular",
    "flush_folder",
    "is_any_unfinished",
    "open_regular",
    "random_letters",
    "read_regular",
    "replacing",
    "write_whole",
]

try:
    import fcntl
except ImportError:  # not available on Windows
    fcntl = None

_LETTERS = 16  # in the names of unfinished files: nobody guesses or repeats them
_LONGEST_STEM = 48  # characters of such a name that are taken from the final one

_PLAIN = 0o666  # permissions before the umask, as `open` asks for
# Each is 0 where the system lacks it.
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_NO_WAIT = getattr(os, "O_NONBLOCK", 0)
_BYTES = getattr(os, "O_BINARY", 0)
_EXCLUSIVE = os.O_RDWR | os.O_CREAT | os.O_EXCL | _NO_LINK | _BYTES


# Descriptors of this process's unfinished files and locks.
_open: set[int] = set()


def is_any_unfinished() -> bool:
    """Whether this process has an unfinished file or holds a lock, which ending would leave."""
    return bool(_open)


def random_letters() -> str:
    """Sixteen random hexadecimal digits, for a name that nothing else has."""
    return secrets.token_hex(_LETTERS // 2)


def flush_folder(folder: Path) -> None:
    """Flushes a folder's directory entries to disk."""
    with contextlib.suppress(OSError):  # unsupported on Windows and some network file systems
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


class Partial:
    """A new, empty file that replaces another one once complete.

    Attributes:
      path: a hidden file, by default in the same folder with the same suffix, since programs may
        choose a format by the suffix. Writers may truncate it, but not put another file in its
        place.
    """

    def __init__(self, path: Path, suffix: str | None = None, folder: Path | None = None) -> None:
        """Creates the file that is to replace `path`.

        Args:
          path: of the complete file.
          suffix: of the hidden file, such as that of an intermediate format; by default the same.
          folder: of the hidden file, on the same file system; by default the same.

        Raises:
          OSError: the folder is missing or not writable, or `path` is a device, a pipe or a socket.
        """
        self._target = path
        _check_replaceable(path)
        ending = path.suffix if suffix is None else suffix
        name = f".{path.stem[:_LONGEST_STEM]}.{random_letters()}{ending}"
        self.path = path.with_name(name) if folder is None else folder / name
        try:
            # Open until the end, so that no other file can get its number in the file system.
            self._number: int | None = os.open(self.path, _EXCLUSIVE, _PLAIN)
        except OSError as error:
            error.filename = str(path)  # the name that the caller knows
            raise
        _open.add(self._number)

    def finish(self) -> None:
        """Flushes the content to disk and moves the file to its final path.

        It gets the permissions of the file that it replaces, if any.

        Raises:
          OSError: that failed, or another process has put another file under the hidden name.
        """
        assert self._number is not None
        if not _is_still_there(self.path, self._number):
            why = "another process has removed or replaced this unfinished file"
            raise FileNotFoundError(errno.ENOENT, why, str(self.path))
        os.fsync(self._number)
        with contextlib.suppress(FileNotFoundError):
            replaced = os.lstat(self._target)
            if stat.S_ISREG(replaced.st_mode):
                os.chmod(self.path, stat.S_IMODE(replaced.st_mode) & 0o777)
        self._close()  # Windows moves no open file
        try:
            os.replace(self.path, self._target)
        except OSError:
            self.path.unlink(missing_ok=True)
            raise
        flush_folder(self._target.parent)

    def discard(self) -> None:
        """Removes the file if it is still there; may be called repeatedly."""
        if self._number is None:
            return
        is_there = _is_still_there(self.path, self._number)
        self._close()
        if is_there:
            self.path.unlink(missing_ok=True)

    def _close(self) -> None:
        number, self._number = self._number, None
        assert number is not None
        _open.discard(number)
        os.close(number)


@contextlib.contextmanager
def replacing(path: Path, suffix: str | None = None, folder: Path | None = None) -> Iterator[Path]:
    """A new, empty file to write to, as for `Partial`; on a clean exit it replaces `path`.

    If the body raises, the new file is removed and `path` is unchanged. An OSError without a file
    name, as for a full disk, gets the name of `path`.
    """
    partial = None
    try:
        partial = Partial(path, suffix, folder)
        yield partial.path
        partial.finish()
    except BaseException as error:
        if partial is not None:
            partial.discard()
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise


def write_whole(path: Path, content: str | bytes) -> None:
    """Writes a file, as `replacing` does; text is UTF-8."""
    with replacing(path) as partial:
        partial.write_bytes(content.encode() if isinstance(content, str) else content)


def appending(path: Path) -> BinaryIO:
    """A file open for unbuffered writing at its end; created if it does not exist.

    Raises:
      OSError: it cannot be written, or is a link or anything else but a regular file.
    """
    flags = os.O_RDWR | os.O_APPEND | os.O_CREAT | _NO_LINK | _NO_WAIT | _BYTES
    number = os.open(path, flags, _PLAIN)
    try:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise OSError(errno.EINVAL, "expected a regular file", str(path))
        return os.fdopen(number, "ab", buffering=0)
    except BaseException:
        os.close(number)
        raise


def _check_replaceable(path: Path) -> None:
    """Raises OSError if a rename would replace something that no program should lose."""
    try:
        kind = os.lstat(path).st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(kind):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not (stat.S_ISREG(kind) or stat.S_ISLNK(kind)):
        why = "a device, a pipe or a socket is there; expected a file's name"
        raise OSError(errno.EEXIST, why, str(path))


class Hold:
    """An exclusive lock on a folder, or on a file to be written, until released.

    On systems and file systems without locks it has no effect.
    """

    def __init__(self, path: Path) -> None:
        """Locks an existing folder, or a file, which need not exist.

        Raises:
          ValueError: another process, or this one, already holds the lock; or something other than
            a lock file has the lock file's name.
          OSError: the file's folder is not writable.
        """
        self._number: int | None = None
        # A folder is locked directly; a file through a lock file next to it, removed on release.
        self._beside = None if path.is_dir() else path.with_name(f".{path.name}.lock")
        if fcntl is None:
            return
        while self._number is None:
            number = self._opened(path)
            try:
                if self._beside is not None:
                    _check_lock_file(self._beside, number)
                _lock(number, path)
            except BaseException:
                os.close(number)
                raise
            if self._beside is not None and not _is_still_there(self._beside, number):
                os.close(number)  # the lock file was removed between the two calls: try again
                continue
            self._number = number
            _open.add(number)

    def release(self) -> None:
        """Releases the lock; may be called repeatedly."""
        number, self._number = self._number, None
        if number is None:
            return
        _open.discard(number)
        if self._beside is not None and _is_still_there(self._beside, number):
            self._beside.unlink(missing_ok=True)
        os.close(number)

    def __enter__(self) -> "Hold":
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def _opened(self, path: Path) -> int:
        if self._beside is None:
            return os.open(path, os.O_RDONLY)
        try:
            return os.open(self._beside, os.O_RDWR | os.O_CREAT | _NO_LINK | _NO_WAIT, _PLAIN)
        except OSError as error:
            if error.errno == errno.ELOOP or self._beside.is_symlink():
                raise _foreign_lock_file(self._beside) from None
            raise


def _check_lock_file(path: Path, number: int) -> None:
    """Raises ValueError unless the open file is an empty one, as all lock files are."""
    status = os.fstat(number)
    if not stat.S_ISREG(status.st_mode) or status.st_size:
        raise _foreign_lock_file(path)


def _foreign_lock_file(path: Path) -> ValueError:
    return ValueError(
        f"{path} is no lock file, which would be a regular file without content: remove it, or "
        "choose another place"
    )


def _lock(number: int, path: Path) -> None:
    assert fcntl is not None
    try:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise ValueError(
            f"another process writes to {path}: wait for it, or choose another place"
        ) from None
    except OSError:  # the file system does not support locks
        pass


def _is_still_there(path: Path, number: int) -> bool:
    """Whether the open file is still the one at `path`."""
    try:
        return os.path.samestat(os.lstat(path), os.fstat(number))
    except FileNotFoundError:
        return False


def check_regular(path: Path) -> None:
    """Checks the file at `path` without opening it.

    Raises:
      OSError: it does not exist, or it is a folder.
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
