"""Files that appear whole or not at all, and folders that one process at a time writes to.

    with Hold(Path("out")), replacing(Path("out/result.json")) as partial:
        partial.write_text(text)

`replacing` guards against failures, interrupts and a loss of power: a file takes its place only
after its content has reached the disk. `Hold` is advisory: it keeps out processes that use it too.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has none
    fcntl = None

__all__ = ["Hold", "flush_folder", "partial_path", "put_in_place", "replacing"]


def partial_path(path: Path) -> Path:
    """Where to write a file that is to take the place of `path` when it is whole.

    It lies beside `path`, hidden, and ends alike, for programs that choose a format by the ending.
    """
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")


def flush_folder(folder: Path) -> None:
    """Flushes the names of a folder's files to the disk."""
    with contextlib.suppress(OSError):  # Windows and some network file systems cannot
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)


def put_in_place(partial: Path, path: Path) -> None:
    """Moves a file that is whole to `path`, after its content has reached the disk."""
    with partial.open("rb+") as file:
        os.fsync(file.fileno())
    os.replace(partial, path)
    flush_folder(path.parent)


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to; on a clean exit what was written takes the place of `path`.

    If the body raises, what was written is removed and `path` stays as it was. An error of writing,
    as on a full disk, which does not say where, is given the file's name.
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
    """Keeps a folder, or a file that is to be written, for this process until it is released.

    Where the system has no locks, as some network file systems, it keeps nobody out.
    """

    def __init__(self, path: Path) -> None:
        """Takes hold of a folder that exists, or of a file, which need not.

        Raises:
          ValueError: another process has hold of it, or this one has already.
          OSError: the folder of the file cannot be written to.
        """
        self._number: int | None = None
        # A folder is locked itself; a file by one beside it, which is removed at the end.
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
                os.close(number)  # it was removed between the two calls: another one is needed
                continue
            self._number = number

    def release(self) -> None:
        """Lets others write; releasing twice is fine."""
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
    except OSError:  # a file system without locks
        pass


def _is_still_there(path: Path, number: int) -> bool:
    """Whether the open file is the one that lies at `path`."""
    try:
        return os.path.samestat(os.stat(path), os.fstat(number))
    except FileNotFoundError:
        return False
