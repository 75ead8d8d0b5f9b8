"""`Remote`: a file or folder at a URL that fsspec reads or writes; needs the extra `data`.

    folder = Remote("https://example.org/walk")
    file = folder / "episodes" / "seeds-0000000000-0000000064.parquet"
    with file.open() as opened:
        opened.read(4)
    Remote("s3://bucket/walk/dataset.json").put(path, Remote("s3://bucket/walk/parts"))

fsspec itself reads `memory://`, `ftp://`, `zip://` and others; `http://`, `s3://`, `hf://` and more
need a package each, which its messages name. A copy in another process opens the file system again.
This is the only module that imports fsspec.
"""

import contextlib
import errno
import fnmatch
import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from limberjack.utils.files import random_letters
from limberjack.utils.requirements import missing_extra

try:
    import fsspec  # pyright: ignore[reportMissingTypeStubs]
    import fsspec.core  # pyright: ignore[reportMissingTypeStubs]
except ImportError as error:
    raise missing_extra("data") from error

__all__ = ["Remote"]

# Bytes that are read at once: an episode of a humanoid takes 0.7 MB, and a request 2 ms or more.
_BLOCK = 2**23

# Protocols of file systems with folders, in which a file that is being written has part of its
# content, and a rename puts it in place at once. Others, such as s3, put whole objects.
_RENAMING = {"dav", "ftp", "hdfs", "local", "sftp", "smb", "ssh", "webdav", "webhdfs"}

# In what is no name of a file: a page of links also leads elsewhere, or to itself in another order.
_OTHER = re.compile(r"[/?#]|^$")
_MISSING, _REFUSED = (404, 410), (401, 403, 405)  # statuses of HTTP

_gives_parts: dict[str, bool] = {}  # by web server, see `Remote._gives_parts`

_Files = Any  # a file system of fsspec, which has no types
_Result = TypeVar("_Result")


class Remote:
    """See the module's docstring."""

    def __init__(self, url: str, inside: tuple[str, ...] = ()) -> None:
        """Opens the file system, which reads nothing.

        Args:
          url: of a file or folder.
          inside: names of folders and a file in it.

        Raises:
          ImportError: a package that the protocol needs is not installed; the message names it.
          ValueError: there is no such protocol.
        """
        self._url, self._inside = url.rstrip("/") if not url.endswith("://") else url, inside
        self._size: object = None  # on a web server, once the file was opened
        files, _ = self._found()
        if not inside:
            files.invalidate_cache()  # of folders, which may have changed since they were listed

    def _found(self) -> tuple[_Files, str]:
        """The file system and the path in it; fsspec keeps one for each process and thread."""
        try:
            files, root = fsspec.core.url_to_fs(self._url)
        except ImportError as error:
            raise ImportError(f"needs another package to read {self._url} ({error})") from error
        except ValueError as error:
            raise ValueError(f"{self._url} is no URL that fsspec reads ({error})") from error
        return files, "/".join([root.rstrip("/"), *self._inside])

    def __truediv__(self, name: str) -> "Remote":
        return Remote(self._url, (*self._inside, name))

    def __str__(self) -> str:
        return "/".join([self._url, *self._inside])

    def __repr__(self) -> str:
        return f"Remote({str(self)!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Remote) and str(other) == str(self)

    def __hash__(self) -> int:
        return hash(str(self))

    @property
    def name(self) -> str:
        """The last part of the path."""
        return str(self).rpartition("/")[2]

    @property
    def suffix(self) -> str:
        """The ending of the name, with its dot."""
        before, dot, ending = self.name.rpartition(".")
        return dot + ending if before else ""

    def exists(self) -> bool:
        """Whether there is such a file or folder."""
        try:
            self._information()
        except FileNotFoundError:
            return False
        return True

    def _information(self) -> dict[str, object]:
        """The properties of the file; raises FileNotFoundError if there is none."""
        files, path = self._found()
        return self._again(files, lambda: files.info(path))

    def _again(self, files: _Files, do: Callable[[], _Result]) -> _Result:
        """The result of a function; a file may have been written since its folder was listed."""
        try:
            with self._reported():
                return do()
        except FileNotFoundError:
            files.invalidate_cache()
        with self._reported():
            return do()

    def size(self) -> int:
        """The bytes of the file."""
        size = self._information()["size"]
        if not isinstance(size, int):
            raise OSError(errno.EIO, "the server does not say how long it is", str(self))
        return size

    def named(self, pattern: str) -> "list[Remote]":
        """The files in the folder that match; none where the server lists no folders."""
        files, path = self._found()
        files.invalidate_cache()
        try:
            with self._reported():
                listed = files.ls(path, detail=False)
        except OSError as error:
            if isinstance(error, FileNotFoundError) or _is_refused(error.__cause__):
                return []
            raise
        begins = f"{path}/"
        names = {one.rstrip("/").removeprefix(begins) for one in listed}
        found = [name for name in sorted(names) if not _OTHER.search(name)]
        return [self / name for name in found if fnmatch.fnmatchcase(name, pattern)]

    def open(self) -> io.BufferedIOBase:
        """The file, open for reading; the caller closes it."""
        files, path = self._found()
        how: dict[str, object] = {"block_size": _BLOCK}
        if "http" in files.protocol:
            self._size = self._size or self._information()["size"]
            how["size"] = self._size
            with self._reported():
                if not self._size or not self._gives_parts(files, path):
                    return io.BytesIO(files.cat_file(path))
        file = self._again(files, lambda: files.open(path, "rb", **how))
        with self._reported():
            if not file.seekable():
                with file:
                    return io.BytesIO(file.read())
        return _Reported(self, file)

    def _gives_parts(self, files: _Files, path: str) -> bool:
        """Whether the web server gives parts of files; each is asked once."""
        server = urlsplit(path).netloc
        if server not in _gives_parts:
            _gives_parts[server] = len(files.cat_file(path, start=0, end=1)) == 1
        return _gives_parts[server]

    def put(self, path: Path, beside: "Remote") -> None:
        """Writes the file, whole or not at all, with the content of one on this machine.

        Args:
          path: of the content.
          beside: the folder of unfinished files, where files are renamed into their places.
        """
        files, place = self._found()
        with self._reported("written"):
            if not _RENAMING.intersection(_protocols(files)):
                files.put_file(str(path), place)
                files.invalidate_cache()
                return
            stem = self.name.rpartition(".")[0]
            unfinished = beside / f".{stem}.{random_letters()}.part"
            _, there = unfinished._found()
            try:
                files.put_file(str(path), there)
                try:
                    files.mv(there, place)
                except Exception:  # some servers do not replace a file
                    self.unlink(missing_ok=True)
                    files.mv(there, place)
            except BaseException:
                with contextlib.suppress(Exception):
                    files.rm_file(there)
                raise
            files.invalidate_cache()

    def rename(self, to: "Remote") -> None:
        """Moves the file to another place in the same file system."""
        files, path = self._found()
        with self._reported("moved"):
            files.mv(path, to._found()[1])
            files.invalidate_cache()

    def unlink(self, missing_ok: bool = False) -> None:
        """Removes the file; with `missing_ok`, if it is there."""
        if missing_ok and not self.exists():
            return
        files, path = self._found()
        with self._reported("removed"):
            files.rm_file(path)
            files.invalidate_cache()

    def mkdir(self, parents: bool = True, exist_ok: bool = True) -> None:
        """Makes the folder and those that it is in, if the file system has folders."""
        files, path = self._found()
        if _RENAMING.intersection(_protocols(files)) and not self.exists():
            with self._reported("made"):
                files.makedirs(path, exist_ok=True)
                files.invalidate_cache()

    def rmdir(self) -> None:
        """Removes the empty folder, if the file system has folders."""
        files, path = self._found()
        with self._reported("removed"):
            files.rmdir(path)
            files.invalidate_cache()

    @contextlib.contextmanager
    def _reported(self, done: str = "read") -> Iterator[None]:
        """Turns the errors of a file system, which may be any, into OSError with a number."""
        try:
            yield
        except Exception as error:
            cause = error.__cause__ if isinstance(error, FileNotFoundError) else error
            if cause is None or _is_missing(cause, done):
                missing = "there is no such file"
                raise FileNotFoundError(errno.ENOENT, missing, str(self)) from None
            error = cause  # fsspec says that a file is missing if the server does not answer, too
            reason = f"{type(error).__name__}: {error}".rstrip(": ")
            raise OSError(errno.EIO, f"it cannot be {done} ({reason})", str(self)) from error


def _protocols(files: _Files) -> set[str]:
    """The names of the protocols of a file system."""
    return {files.protocol} if isinstance(files.protocol, str) else {*files.protocol}


def _is_missing(error: BaseException, done: str) -> bool:
    """Whether a file system, a web server or an FTP server says that there is no such file."""
    if isinstance(error, FileNotFoundError | StopIteration):  # the latter from a list of names
        return True
    # To other requests than reading, FTP's 550 is any refusal.
    is_refused = done == "read" and str(error).startswith("550 ")
    return is_refused or getattr(error, "status", None) in _MISSING


def _is_refused(error: BaseException | None) -> bool:
    """Whether the file system, or a web server, lists no folders, or none to this user."""
    status = getattr(error, "status", None)
    return isinstance(error, PermissionError | NotImplementedError) or status in _REFUSED


class _Reported(io.BufferedIOBase):
    """A file of fsspec whose errors are those of `Remote`."""

    def __init__(self, place: Remote, file: Any) -> None:
        """Takes the file over; it is Any because fsspec has no types."""
        self._place, self._file = place, file

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def read(self, size: int | None = -1) -> bytes:
        with self._place._reported():
            return self._file.read(-1 if size is None else size)

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        self._file.close()
        super().close()
