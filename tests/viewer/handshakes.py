"""Requests to a viewer, byte by byte: a browser or a library would correct them.

answer = ask(port, "/state", {"Origin": "http://evil.example", **WEBSOCKET})
assert answer.status == 403
"""

import dataclasses
import socket
import time
from collections.abc import Mapping

__all__ = ["WEBSOCKET", "Answer", "ask", "connect", "head", "seconds_until_closed"]

_LIMIT = 60.0  # seconds for anything, on the slowest machine too

WEBSOCKET = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


@dataclasses.dataclass(frozen=True)
class Answer:
    """The status and the rest of what came back."""

    status: int
    headers: dict[str, str]  # names in lower case
    text: str  # the first bytes that follow; of a WebSocket, its frames


def connect(port: int) -> socket.socket:
    """A connection to a port of this machine."""
    return socket.create_connection(("127.0.0.1", port), timeout=_LIMIT)


def head(path: str, headers: Mapping[str, str], method: str = "GET") -> bytes:
    """The bytes of a request."""
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in headers.items())]
    return "\r\n".join([*lines, "", ""]).encode("latin-1")


def ask(
    port: int, path: str, headers: Mapping[str, str], method: str = "GET", after: bytes = b""
) -> Answer:
    """The answer to one request; `Host` is localhost and the port if it is not given.

    `after` is sent at once after the request.
    """
    with connect(port) as connection:
        given = {"Host": f"localhost:{port}", **headers}
        connection.sendall(head(path, given, method) + after)
        got = b""
        while b"\r\n\r\n" not in got:
            received = connection.recv(1 << 16)
            assert received, f"no answer but {got!r}"
            got += received
        first, _, text = got.partition(b"\r\n\r\n")
        lines = first.decode("latin-1").split("\r\n")
        found: dict[str, str] = {}
        for line in lines[1:]:  # Studio repeats some, with the same value
            name, value = line.split(": ", 1)
            assert found.setdefault(name, value) == value, f"{name} twice: {lines}"
        length = int(found.get("Content-Length", 0))
        while len(text) < length and (received := connection.recv(1 << 16)):
            text += received
    lowered = {name.lower(): value for name, value in found.items()}
    return Answer(int(lines[0].split()[1]), lowered, text.decode("latin-1"))


def seconds_until_closed(connection: socket.socket) -> float:
    """Reads until the other side closes; the time that this took."""
    begun = time.monotonic()
    try:
        while connection.recv(1 << 16):
            pass
    except ConnectionResetError:
        pass
    return time.monotonic() - begun
