"""The guard on a server of `websockets`, without MuJoCo Studio."""

import asyncio
import contextlib
import threading
from collections.abc import Iterator
from typing import Any

import pytest

from limberjack.viewer.access import Access, Address, find_address
from limberjack.viewer.guard import Guard

from .handshakes import WEBSOCKET, ask, connect, head, seconds_until_closed

server = pytest.importorskip("websockets.asyncio.server", reason="needs the package websockets")

_SHORT = 0.5  # seconds
_LARGE = 1 << 23  # bytes; more than sockets buffer


class _Served:
    """A server in a thread of its own, and what reached it."""

    def __init__(self, address: Address) -> None:
        self.access = Access(address, ["viewer.example.org"])
        self.guard = Guard(
            self.access,
            server.serve,
            server.ServerConnection,
            addition=b"<p>more</p>",
            reports={"/slow": lambda: self.reported.append("slow")},
        )
        self.reported: list[str] = []
        self.page = "xx"
        self.port = address.port
        self.cookie = f"limberjack-{self.port}={self.access.token}"
        self.reached: list[str] = []
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=[self._run()])
        self._thread.start()
        self.guard.wait(60.0)

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()
        self._loop.close()

    async def _run(self) -> None:
        made = await self.guard.serve(
            self._handle,
            host="127.0.0.1",
            port=self.port,
            process_request=self._answer,
            process_response=lambda connection, request, response: None,
            open_timeout=None,
            max_size=2**26,
        )
        await self._stop.wait()
        made.close()
        await made.wait_closed()

    async def _handle(self, connection: Any) -> None:
        async for message in connection:
            self.reached.append(message)

    def _answer(self, connection: Any, request: Any) -> Any:
        self.reached.append(request.path)
        if request.path == "/state":
            return None
        response = connection.respond(200, "x" * _LARGE if request.path == "/model" else self.page)
        response.headers["Access-Control-Allow-Origin"] = "*"
        return response


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[_Served]:
    monkeypatch.setattr("limberjack.viewer.guard._HANDSHAKE_LIMIT", _SHORT)
    with contextlib.closing(_Served(find_address())) as made:
        yield made


def test_the_printed_address_opens_the_page_and_its_cookie_all_else(served: _Served) -> None:
    answer = ask(served.port, f"/?token={served.access.token}", {})
    assert (answer.status, answer.text) == (200, "xx")
    assert answer.headers["set-cookie"].startswith(f"{served.cookie};")
    cookie = {"Cookie": served.cookie}
    assert ask(served.port, "/other", cookie).status == 200
    assert ask(served.port, "/state", cookie | WEBSOCKET).status == 101


def test_the_page_alone_has_the_addition_and_its_length(served: _Served) -> None:
    served.page = "<body></body>"
    answer = ask(served.port, f"/?token={served.access.token}", {})
    assert answer.text == "<body><p>more</p></body>"
    assert answer.headers["content-length"] == str(len(answer.text))
    assert ask(served.port, "/other", {"Cookie": served.cookie}).text == "<body></body>"
    assert "more" not in ask(served.port, "/", {}).text  # which is refused


def test_a_report_of_the_page_is_heard_and_reaches_nothing_else(served: _Served) -> None:
    assert ask(served.port, "/slow", {}).status == 403
    assert served.reported == []
    assert ask(served.port, "/slow", {"Cookie": served.cookie}).status == 204
    assert (served.reported, served.reached) == (["slow"], [])


def test_no_other_page_can_read_an_answer_or_frame_it(served: _Served) -> None:
    for path, status in ((f"/?token={served.access.token}", 200), ("/", 403)):
        answer = ask(served.port, path, {})
        assert answer.status == status
        assert "access-control-allow-origin" not in answer.headers
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert answer.headers["content-security-policy"] == "frame-ancestors 'self'"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["x-content-type-options"] == "nosniff"
    assert "set-cookie" not in ask(served.port, "/", {}).headers


def test_what_is_refused_reaches_nothing(served: _Served) -> None:
    good = {"Cookie": served.cookie, **WEBSOCKET}
    frame = b"\x81\x84\x00\x00\x00\x00quit"
    for path, bad in [
        ("/state", {"Origin": "http://evil.example"}),
        ("/state", {"Host": "evil.example"}),
        ("/state", {"Cookie": "limberjack-8080=guess"}),
        ("/drop", {}),
    ]:
        answer = ask(served.port, path, good | bad, after=frame)
        assert answer.status == 403
        assert answer.text.startswith("limberjack: ")
    assert ask(served.port, "/", good, method="POST").status == 403
    assert served.reached == []
    assert ask(served.port, "/state", good, after=frame).status == 101  # the same, permitted
    assert served.reached[0] == "/state"


def test_a_refused_request_gets_no_cookie_for_the_right_token(served: _Served) -> None:
    answer = ask(served.port, f"/?token={served.access.token}", {"Origin": "http://evil.example"})
    assert answer.status == 403
    assert "set-cookie" not in answer.headers


def test_a_host_that_is_allowed_is_answered(served: _Served) -> None:
    host = {
        "Host": "viewer.example.org",
        "Origin": "https://viewer.example.org",
        "Cookie": served.cookie,
    }
    assert ask(served.port, "/other", host).status == 200


def test_handshakes_that_are_not_finished_are_closed(served: _Served) -> None:
    half = head("/state", {"Host": f"localhost:{served.port}"})[:-4]
    for sent in (b"", half):
        with connect(served.port) as connection:
            connection.sendall(sent)
            assert _SHORT / 2 < seconds_until_closed(connection) < 10 * _SHORT
    with connect(served.port) as refused:
        refused.sendall(head("/state", {"Host": "evil.example"}))
        assert seconds_until_closed(refused) < 10 * _SHORT


def test_a_slow_download_and_an_open_websocket_outlast_the_limit(served: _Served) -> None:
    permitted = {"Host": f"localhost:{served.port}", "Cookie": served.cookie}
    with connect(served.port) as slow, connect(served.port) as opened:
        slow.sendall(head("/model", permitted))
        opened.sendall(head("/state", {**permitted, **WEBSOCKET}))
        assert opened.recv(1 << 16).startswith(b"HTTP/1.1 101")
        threading.Event().wait(3 * _SHORT)
        received = 0
        while received < _LARGE and (part := slow.recv(1 << 20)):
            received += len(part)
        assert received >= _LARGE
        opened.setblocking(False)
        with pytest.raises(BlockingIOError):
            opened.recv(1)


def test_a_download_that_nobody_reads_is_closed_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("limberjack.viewer.guard._DOWNLOAD_LIMIT", _SHORT)
    with contextlib.closing(_Served(find_address())) as served:
        permitted = {"Host": f"localhost:{served.port}", "Cookie": served.cookie}
        with connect(served.port) as slow, connect(served.port) as opened:
            opened.sendall(head("/state", permitted | WEBSOCKET))
            assert opened.recv(1 << 16).startswith(b"HTTP/1.1 101")
            slow.sendall(head("/model", permitted))
            threading.Event().wait(3 * _SHORT)
            received = 0
            with contextlib.suppress(ConnectionResetError):
                while part := slow.recv(1 << 20):
                    received += len(part)
            opened.setblocking(False)
            with pytest.raises(BlockingIOError):  # a WebSocket is no download
                opened.recv(1)
    assert received < _LARGE


def test_messages_are_no_longer_than_an_interface_needs(served: _Served) -> None:
    long = (1 << 20) + 1
    frame = b"\x82\xff" + long.to_bytes(8, "big") + bytes(4)
    with connect(served.port) as connection:
        permitted = {"Host": f"localhost:{served.port}", "Cookie": served.cookie, **WEBSOCKET}
        connection.sendall(head("/state", permitted))
        assert connection.recv(1 << 16).startswith(b"HTTP/1.1 101")
        connection.sendall(frame)
        assert (1009).to_bytes(2, "big") in connection.recv(1 << 16)  # "message too big"
    assert served.reached == ["/state"]


def test_a_server_that_cannot_listen_is_reported() -> None:
    async def fail(*arguments: object, **options: object) -> Any:
        raise OSError("in use")

    guard = Guard(Access(Address("127.0.0.1", 8080)), fail, server.ServerConnection)
    with pytest.raises(TimeoutError):
        guard.wait(0.0)
    nothing: Any = None
    with pytest.raises(OSError, match="in use"):
        asyncio.run(guard.serve(nothing, process_request=nothing, process_response=nothing))
    with pytest.raises(OSError, match="in use"):
        guard.wait(0.0)
