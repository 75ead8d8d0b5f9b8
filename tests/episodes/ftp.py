"""A server of files on this machine that clients may write to, by FTP as RFC 959 and 3659 have it.

    with ftp_serving(folder) as url:        # ftp://127.0.0.1:40123
        ...

It has the commands that `ftplib` sends for fsspec, and trusts its client: it is for tests only.
"""

import contextlib
import shutil
import socket
import socketserver
from collections.abc import Callable, Iterator
from pathlib import Path

from .serving import in_a_thread

__all__ = ["ftp_serving"]

_COPY = 2**16  # bytes at a time


class _Client(socketserver.StreamRequestHandler):
    """Answers a client, whose working directory stays the root."""

    def handle(self) -> None:
        """Answers commands until the client leaves."""
        assert isinstance(self.server, _Server)
        # The end of the command ABOR comes out of band.
        self.request.setsockopt(socket.SOL_SOCKET, socket.SO_OOBINLINE, 1)
        self._root = self.server.root
        self._offset, self._from, self._data = 0, Path(), socket.socket()
        self._say("220 ready")
        with contextlib.suppress(ConnectionError):
            while line := self.rfile.readline():
                name, _, argument = line.decode().strip().partition(" ")
                do = getattr(self, f"_{name.lower()}", None)
                try:
                    self._say("502 unknown" if do is None else do(argument))
                except (FileNotFoundError, NotADirectoryError):
                    self._say("550 there is no such file")
                except OSError as error:
                    self._say(f"550 {error.strerror}")
        self._data.close()

    def _say(self, line: str) -> None:
        self.wfile.write(f"{line}\r\n".encode())

    def _path(self, argument: str) -> Path:
        return self._root / argument.strip("/")

    def _user(self, name: str) -> str:
        return "230 welcome"

    def _type(self, kind: str) -> str:
        return "200 as always"

    def _cwd(self, name: str) -> str:
        if not self._path(name).is_dir():
            raise FileNotFoundError
        return "250 here"

    def _pwd(self, nothing: str) -> str:
        return '257 "/"'

    def _size(self, name: str) -> str:
        return f"213 {self._path(name).stat().st_size}"

    def _dele(self, name: str) -> str:
        self._path(name).unlink()
        return "250 removed"

    def _mkd(self, name: str) -> str:
        self._path(name).mkdir()
        return f'257 "{name}"'

    def _rmd(self, name: str) -> str:
        self._path(name).rmdir()
        return "250 removed"

    def _rnfr(self, name: str) -> str:
        self._from = self._path(name)
        return "350 to where"

    def _rnto(self, name: str) -> str:
        self._from.rename(self._path(name))
        return "250 renamed"

    def _rest(self, offset: str) -> str:
        self._offset = int(offset)
        return "350 from there"

    def _abor(self, nothing: str) -> str:
        return "226 nothing runs"

    def _pasv(self, nothing: str) -> str:
        self._data.close()
        self._data = socket.create_server(("127.0.0.1", 0))
        high, low = divmod(self._data.getsockname()[1], 256)
        return f"227 at (127,0,0,1,{high},{low})"

    def _retr(self, name: str) -> str:
        with self._path(name).open("rb") as file:
            file.seek(self._offset)
            self._offset = 0
            return self._transferred(lambda stream: shutil.copyfileobj(file, stream, _COPY))

    def _stor(self, name: str) -> str:
        with self._path(name).open("wb") as file:
            return self._transferred(lambda stream: shutil.copyfileobj(stream, file, _COPY))

    def _mlsd(self, name: str) -> str:
        lines = []
        for path in sorted(self._path(name).iterdir()):
            kind, size = ("dir", 0) if path.is_dir() else ("file", path.stat().st_size)
            lines.append(f"type={kind};size={size};modify=20261101000000; {path.name}\r\n")
        return self._transferred(lambda stream: stream.write("".join(lines).encode()))

    def _transferred(self, do: "Callable[..., object]") -> str:
        self._say("150 begins")
        connection, _ = self._data.accept()
        # A client that has read enough ends the connection.
        with connection, contextlib.suppress(ConnectionError), connection.makefile("rwb") as stream:
            do(stream)
        return "226 done"


class _Server(socketserver.ThreadingTCPServer):
    daemon_threads = True
    root: Path


@contextlib.contextmanager
def ftp_serving(folder: Path) -> Iterator[str]:
    """The URL of a folder while a server runs in a thread."""
    with _Server(("127.0.0.1", 0), _Client) as server:
        server.root = folder
        with in_a_thread(server):
            yield f"ftp://127.0.0.1:{server.server_address[1]}"
