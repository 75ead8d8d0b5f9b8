"""Atomic file replacement, and locks that let one process at a time write to a folder.

    with Hold(Path("out")), replacing(Path("out/result.json")) as partial:
        partial.write_text(text)

`replacing` protects against failures, interrupts and power loss: a file is put in place only after
its content has reached the disk. `Hold` is advisory: it excludes only processes that also use it.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # not available on Windows
    fcntl = None

__all__ = ["Hold", "flush_folder", "partial_path", "put_in_place", "replacing"]


def partial_path(path: Path) -> Path:
    """Temporary path for a file that replaces `path` once complete.

    It is a hidden file next to `path` with the same suffix, since programs may choose a format by
    the suffix.
    """
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")


def flush_folder(folder: Path) -> None:
    """Flushes a folder's directory entries to disk."""
    with contextlib.suppress(OSError):  # unsupported on Windows and some network file systems
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def put_in_place(partial: Path, path: Path) -> None:
    """Moves a complete file to `path` after flushing its content to disk."""
    with partial.open("rb+") as file:
        os.fsync(file.fileno())
    os.replace(partial, path)
    flush_folder(path.parent)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to; on a clean exit the file written there replaces `path`.

    If the body raises, that file is removed and `path` is unchanged. An OSError without a file
    name, as for a full disk, is given that of `path`.
    """
    partial = partial_path(path)
    try:
        yield partial
        put_in_place(partial, path)
    except BaseException as error:
        partial.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise


class Hold:
    """An exclusive lock on a folder, or on a file to be written, until released.

    On systems and file systems without locks it has no effect.
    """

    def __init__(self, path: Path) -> None:
        """Locks an existing folder, or a file, which need not exist.

        Raises:
          ValueError: another process, or this one, already holds the lock.
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
                _lock(number, path)
            except BaseException:
                os.close(number)
                raise
            if self._beside is not None and not _is_still_there(self._beside, number):
                os.close(number)  # the lock file was removed between the two calls: try again
                continue
            self._number = number

    def release(self) -> None:
        """Releases the lock; may be called repeatedly."""
        number, self._number = self._number, None
        if number is None:
            return
        if self._beside is not None:
            self._beside.unlink(missing_ok=True)
        os.close(number)

    def __enter__(self) -> "Hold":
        return self

    def __exit__(self, *error: object) -> None:
        self.release()

    def _opened(self, path: Path) -> int:
        if self._beside is None:
            return os.open(path, os.O_RDONLY)
        return os.open(self._beside, os.O_RDWR | os.O_CREAT, 0o644)


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
        return os.path.samestat(os.stat(path), os.fstat(number))
    except FileNotFoundError:
        return False
