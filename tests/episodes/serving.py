"""A web server on this machine, which serves a folder as servers of files do."""

import contextlib
import functools
import http.server
import io
import os
import re
import socketserver
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

__all__ = ["Files", "Unlisted", "Whole", "in_a_thread", "serving"]


class Whole(http.server.SimpleHTTPRequestHandler):
    """Gives whole files and lists folders."""

    def log_message(self, format: str, *arguments: object) -> None:
        """Prints nothing."""


class Files(Whole):
    """Gives parts of files, too."""

    def send_head(self) -> "io.BytesIO | BinaryIO | None":
        """The answer's head, and what it is about."""
        wanted = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        path = Path(self.translate_path(self.path))
        if wanted is None or not path.is_file():
            return super().send_head()
        size = path.stat().st_size
        first, last = int(wanted[1]), min(int(wanted[2] or size), size - 1)
        with path.open("rb") as file:
            file.seek(first)
            part = file.read(last + 1 - first)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {first}-{last}/{size}")
        self.send_header("Content-Length", str(len(part)))
        self.end_headers()
        return io.BytesIO(part)

    def end_headers(self) -> None:
        """Says that it gives parts."""
        self.send_header("Accept-Ranges", "bytes")
        super().end_headers()


class Unlisted(Files):
    """Refuses to list folders."""

    def list_directory(self, path: "str | os.PathLike[str]") -> io.BytesIO | None:
        """The refusal."""
        self.send_error(403)
        return None


class _Server(http.server.ThreadingHTTPServer):
    """Prints nothing where a client ends before its answer does."""

    daemon_threads = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignores it."""


@contextlib.contextmanager
def in_a_thread(server: socketserver.BaseServer) -> Iterator[None]:
    """Lets a server run."""
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        thread.join()


@contextlib.contextmanager
def serving(folder: Path, handler: type[Whole] = Files) -> Iterator[str]:
    """The URL of a folder while a server runs in a thread."""
    made = functools.partial(handler, directory=str(folder))
    with _Server(("127.0.0.1", 0), made) as server, in_a_thread(server):
        yield f"http://127.0.0.1:{server.server_port}"
