"""`Address`: where the web viewer listens; `Access`: the rules by which it answers, and its token.

    access = Access(find_address(), allow_hosts=["viewer.example.org"])
    print(access.url)  # the address to open in a browser; it carries the token

Three things must hold. The header `Host` names this machine: no page can reach the viewer under a
name of its own. The header `Origin`, if there is one, is that same host and port: no page but the
viewer's own can read from it or send to it. The token is right: no other user of the machine gets
in. The printed address brings it, and a cookie keeps it. `/drop`, the path of Studio's uploads, is
always refused.

The rules need no server and no package; `limberjack.viewer.guard` applies them to one. They do not
encrypt, and they do not limit how much those do who have the token.

Finding an address says early that a port is in use; listening takes the port, or the next one where
none was asked for and another program was faster.
"""

import dataclasses
import errno
import hmac
import ipaddress
import re
import secrets
import socket
import urllib.parse
from collections.abc import Sequence

__all__ = ["Access", "Address", "Request", "find_address"]

_TOKEN_BYTES = 32  # of randomness: too many to guess
_PAGE = "/"  # the only path to which the address can bring the token
_UPLOADS = "/drop"  # where Studio's page sends files
_PORTS = {"http": 80, "https": 443}  # which browsers leave out of Host and Origin
_HOST = re.compile(r"(?:\[(?P<six>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(?::(?P<port>[0-9]{1,5}))?")
_ORIGIN = re.compile(r"(?P<scheme>https?)://(?P<host>[^/]*)")

_FIRST_PORT = 8080
_PORTS_TO_TRY = 100  # after the first


@dataclasses.dataclass(frozen=True)
class Address:
    """A port of an interface of this machine."""

    host: str  # in numbers
    port: int
    is_fixed: bool = True  # False where another port will do

    @property
    def url(self) -> str:
        """The address that a browser on this machine opens."""
        ip = ipaddress.ip_address(self.host)
        host = "localhost" if ip.is_unspecified else self.host
        return f"http://[{host}]:{self.port}/" if ":" in host else f"http://{host}:{self.port}/"

    @property
    def is_local(self) -> bool:
        """Whether only programs on this machine can reach it."""
        return ipaddress.ip_address(self.host).is_loopback

    def listen(self) -> socket.socket:
        """A socket that listens here, or on the next free port where the port is not fixed.

        Raises:
          OSError: the port is in use.
        """
        try:
            return _listening(self.host, self.port)
        except OSError as error:
            if self.is_fixed or error.errno != errno.EADDRINUSE:
                raise
        return _listening(self.host, _free_port(self.host, self.port + 1))


def find_address(host: str = "127.0.0.1", port: int | None = None) -> Address:
    """An address that is free now.

    Args:
      host: a name or number of this machine; 0.0.0.0 and :: are all its networks.
      port: 1 to 65535; None for the first free one from 8080 on.

    Raises:
      ValueError: the port is in use or no port, or the host is not this machine.
    """
    number = _numeric(host)
    if port is None:
        return Address(number, _free_port(number, _FIRST_PORT), is_fixed=False)
    if not 1 <= port <= 65535:
        raise ValueError(f"port is {port}; expected 1 to 65535")
    reason = _refusal(number, port)
    if reason is None:
        return Address(number, port)
    if reason in (errno.EADDRINUSE, errno.EACCES):
        why = "in use" if reason == errno.EADDRINUSE else "for administrators only"
        free = _free_port(number, port + 1 if port >= 1024 else _FIRST_PORT)
        raise ValueError(f"port {port} is {why}; port {free} is free")
    raise ValueError(_foreign(host))


def _numeric(host: str) -> str:
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        raise ValueError(_foreign(host)) from error
    number = str(found[0][4][0])
    if _refusal(number, 0) is not None:
        raise ValueError(_foreign(host))
    return number


def _foreign(host: str) -> str:
    return (
        f"host {host!r} is not an address of this machine; expected 127.0.0.1 (this machine only), "
        "0.0.0.0 (all its networks) or one of its own addresses"
    )


def _free_port(host: str, first: int) -> int:
    """The first free port from `first` on, or whichever the system gives."""
    for port in range(first, min(first + _PORTS_TO_TRY, 65536)):
        if _refusal(host, port) is None:
            return port
    with _listening(host, 0) as any_port:
        return any_port.getsockname()[1]


def _refusal(host: str, port: int) -> int | None:
    """The number of the error with which the system refuses to listen there; None if it does not.

    Another program may take it between this and its use.
    """
    try:
        _listening(host, port).close()
    except OSError as error:
        return error.errno or errno.EADDRNOTAVAIL
    return None


def _listening(host: str, port: int) -> socket.socket:
    """A socket that listens there; where the host is ::, to the networks of IPv4 too."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    both = host == "::" and socket.has_dualstack_ipv6()
    return socket.create_server((host, port), family=family, dualstack_ipv6=both)


@dataclasses.dataclass(frozen=True)
class Request:
    """The parts of an HTTP request that decide whether it is answered."""

    method: str
    path: str  # with its query
    headers: Sequence[tuple[str, str]]
    arrived_at: str  # the address of this machine that the connection was made to, in numbers

    def values(self, header: str) -> list[str]:
        """All values of a header, in their order."""
        return [value for name, value in self.headers if name.lower() == header.lower()]


class Access:
    """The hosts and the token of one viewer; see the module's docstring."""

    def __init__(self, address: Address, allow_hosts: Sequence[str] = ()) -> None:
        """Draws a token.

        Args:
          address: where the viewer listens.
          allow_hosts: names that requests may have in `Host` besides this machine's, without port:
            of a proxy or a tunnel with a name of its own.

        Raises:
          ValueError: one of `allow_hosts` is not a host name.
          TypeError: it is one name instead of a list.
        """
        if isinstance(allow_hosts, str):  # whose letters are names too
            raise TypeError(f"allow_hosts is {allow_hosts!r}; expected a list: [{allow_hosts!r}]")
        self.address = address
        self.token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._allowed = {_checked_name(name) for name in allow_hosts}

    @property
    def url(self) -> str:
        """The address that a browser on this machine opens, with the token."""
        return f"{self.address.url}?token={self.token}"

    def refusal(self, request: Request) -> str | None:
        """The reason not to answer the request, for the person who made it; None to answer it."""
        host = _only(request.values("Host"))
        parsed = _HOST.fullmatch(host.lower())
        if parsed is None or not self._names_this_machine(parsed, request.arrived_at):
            return (
                f"Host is {host!r}; expected localhost, the address that the viewer listens on, or "
                "a name that it was started with: --allow-host NAME"
            )
        for origin in request.values("Origin"):
            if not _is_same(origin.lower(), parsed):
                return f"Origin is {origin!r}; expected the viewer's own page, at {host!r}"
        path = request.path.partition("?")[0]
        if request.method != "GET" or not path.startswith("/"):
            return f"the request is {request.method} {path!r}; expected GET and a path"
        if path == _UPLOADS:
            return "files are refused: the viewer shows one environment"
        if not (self._has_cookie(request) or self._brings_token(request)):
            return "the token is missing or wrong: open the address that the viewer printed"
        return None

    def cookie(self, request: Request) -> str | None:
        """The header `Set-Cookie` of the answer, where the address brought the token."""
        if not self._brings_token(request):
            return None
        return f"{self._cookie_name(request)}={self.token}; Path=/; HttpOnly; SameSite=Strict"

    def _names_this_machine(self, host: re.Match[str], arrived_at: str) -> bool:
        name = host["name"] or host["six"]
        if name == "localhost" or name in self._allowed:
            return True
        number = _number(name)
        if number is None:
            return False
        bound = _number(self.address.host)
        if bound is None or bound.is_unspecified:  # it listens on all of the machine's addresses
            bound = _number(arrived_at)
        return number.is_loopback or number == bound

    def _has_cookie(self, request: Request) -> bool:
        pairs = (
            pair.partition("=") for value in request.values("Cookie") for pair in value.split(";")
        )
        name = self._cookie_name(request)
        return any(self._is_token(value) for key, _, value in pairs if key.strip() == name)

    def _brings_token(self, request: Request) -> bool:
        path, _, query = request.path.partition("?")
        found = urllib.parse.parse_qs(query).get("token", [])
        return path == _PAGE and len(found) == 1 and self._is_token(found[0])

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.strip().encode("utf-8", "replace"), self.token.encode())

    def _cookie_name(self, request: Request) -> str:
        """A name with the browser's port: cookies of one host are shared among its ports."""
        host = _HOST.fullmatch(_only(request.values("Host")).lower())
        port = host["port"] if host is not None else None
        return f"limberjack-{port or self.address.port}"


def _checked_name(name: str) -> str:
    parsed = _HOST.fullmatch(name.lower())
    if parsed is None or parsed["port"] is not None:
        raise ValueError(
            f"allowed host is {name!r}; expected a name such as viewer.example.org, without "
            "scheme, port and path"
        )
    return parsed["name"] or parsed["six"]


def _only(values: list[str]) -> str:
    """The value of a header that must be there once; text that names no host otherwise."""
    return values[0] if len(values) == 1 else " and ".join(values)


def _is_same(origin: str, host: re.Match[str]) -> bool:
    """Whether an origin is the page's own: the host that was asked, with its port."""
    parts = _ORIGIN.fullmatch(origin)
    other = None if parts is None else _HOST.fullmatch(parts["host"])
    if parts is None or other is None:
        return False
    default = _PORTS[parts["scheme"]]
    ports = [int(which["port"] or default) for which in (other, host)]
    return (other["name"], other["six"]) == (host["name"], host["six"]) and ports[0] == ports[1]


def _number(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        number = ipaddress.ip_address(text)
    except ValueError:
        return None
    mapped = number.ipv4_mapped if number.version == 6 else None
    return number if mapped is None else mapped
