"""`Guard`: a server of the library `websockets` that answers only what `Access` permits.

    guard = Guard(Access(address), websockets.asyncio.server.serve, ServerConnection)
    server = await guard.serve(handler, sock=..., process_request=..., process_response=...)

`Guard.serve` takes the place of `serve` in MuJoCo Studio, which calls it. A request that is refused
gets status 403 and a line of text, and reaches nothing of Studio's. A connection that has made no
permitted request ten seconds after it was opened is closed. The page can have an addition, which
reports by requests of its own.

It imports neither `websockets` nor MuJoCo Studio: it is given both.
"""

import asyncio
import concurrent.futures
import weakref
from collections.abc import Awaitable, Callable, Mapping
from http import HTTPStatus
from typing import TYPE_CHECKING

from limberjack.viewer.access import Access, Request

if TYPE_CHECKING:
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.http11 import Request as HttpRequest
    from websockets.http11 import Response

    _Handler = Callable[[ServerConnection], Awaitable[None]]
    _Check = Callable[[ServerConnection, HttpRequest], Response | None]
    _Finish = Callable[[ServerConnection, HttpRequest, Response], Response | None]
    _Serve = Callable[..., Awaitable[Server]]
    _Connect = Callable[..., ServerConnection]

__all__ = ["Guard"]

_HANDSHAKE_LIMIT = 10.0  # seconds from a connection's start to a request that is permitted
_DOWNLOAD_LIMIT = 600.0  # seconds; a model of 13 MB at 200 kbit/s
_LONGEST_MESSAGE = 2**20  # bytes; Studio's own limit, 64 times as much, is for uploads
_PAGE, _END = "/", b"</body>"
_SWITCHING = 101  # the status of an answer that opens a WebSocket
# Other pages can neither read an answer nor show it in a frame; the token stays in the address.
_HEADERS = {
    "Cross-Origin-Resource-Policy": "same-origin",
    "Content-Security-Policy": "frame-ancestors 'self'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Guard:
    """One server's checks; see the module's docstring."""

    def __init__(
        self,
        access: Access,
        serve: "_Serve",
        connect: "_Connect",
        addition: bytes = b"",
        reports: Mapping[str, Callable[[], object]] | None = None,
    ) -> None:
        """Prepares them.

        Args:
          access: the rules.
          serve: of `websockets.asyncio.server`.
          connect: its `ServerConnection`.
          addition: HTML for the end of the page's body.
          reports: by path, what is called, in the server's thread, when it is requested.
        """
        self._reports = reports or {}
        self._addition = addition
        self._access = access
        self._serve = serve
        self._connect = connect
        self._permitted: weakref.WeakSet[ServerConnection] = weakref.WeakSet()
        self._started: concurrent.futures.Future[None] = concurrent.futures.Future()

    def wait(self, limit: float) -> None:
        """Returns once the server listens with these checks; for another thread.

        Raises:
          TimeoutError: it does not after so many seconds.
          OSError: it cannot.
        """
        self._started.result(limit)

    async def serve(
        self,
        handler: "_Handler",
        *,
        process_request: "_Check",
        process_response: "_Finish",
        **options: object,
    ) -> "Server":
        """The server that `serve` makes, with the checks before `process_request`."""

        def check(connection: "ServerConnection", request: "HttpRequest") -> "Response | None":
            refusal = self._access.refusal(_seen(connection, request))
            if refusal is not None:
                return connection.respond(403, f"limberjack: {refusal}\n")
            self._permitted.add(connection)
            report = self._reports.get(request.path.partition("?")[0])
            if report is not None:
                report()
                return connection.respond(HTTPStatus.NO_CONTENT, "")
            return process_request(connection, request)

        def finish(
            connection: "ServerConnection", request: "HttpRequest", response: "Response"
        ) -> "Response":
            response = process_response(connection, request, response) or response
            self._finish(connection, request, response)
            return response

        options |= {"max_size": _LONGEST_MESSAGE, "create_connection": self._accept}
        try:
            server = await self._serve(
                handler, process_request=check, process_response=finish, **options
            )
        except BaseException as error:
            self._started.set_exception(error)
            raise
        self._started.set_result(None)
        return server

    def _accept(self, *args: object, **options: object) -> "ServerConnection":
        """A connection that is closed unless it makes a permitted request in time.

        A limit for the whole handshake, as `websockets` has it, would cut short the download of a
        model, which is part of it.
        """
        connection = self._connect(*args, **options)

        def expire() -> None:
            if connection not in self._permitted:
                connection.transport.abort()

        asyncio.get_running_loop().call_later(_HANDSHAKE_LIMIT, expire)
        return connection

    def _finish(
        self, connection: "ServerConnection", request: "HttpRequest", response: "Response"
    ) -> None:
        """Sets the headers of an answer, and a limit of time where it opens no WebSocket."""
        headers = response.headers
        for name in ("Access-Control-Allow-Origin", *_HEADERS):
            if name in headers:
                del headers[name]  # values would add up
        for name, value in _HEADERS.items():
            headers[name] = value
        if connection not in self._permitted:
            return
        if request.path.partition("?")[0] == _PAGE and response.status_code == HTTPStatus.OK:
            response.body = response.body.replace(_END, self._addition + _END)
            del headers["Content-Length"]
            headers["Content-Length"] = str(len(response.body))
        cookie = self._access.cookie(_seen(connection, request))
        if cookie is not None:
            headers["Set-Cookie"] = cookie
        if response.status_code != _SWITCHING:
            asyncio.get_running_loop().call_later(_DOWNLOAD_LIMIT, connection.transport.abort)


def _seen(connection: "ServerConnection", request: "HttpRequest") -> Request:
    """A request as the rules take it."""
    # Versions of `websockets` without this attribute take GET only.
    method = getattr(request, "method", "GET")
    arrived_at = connection.local_address[0]
    return Request(method, request.path, list(request.headers.raw_items()), arrived_at)
