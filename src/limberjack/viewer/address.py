"""`Address`: the host and port on which the web viewer listens.

    address = find_address()  # this machine only, port 8080 or the next that is free
    with address.listen() as listening:
        print(listening.getsockname())

Finding an address says early that a port is in use; listening takes the port, or the next one where
none was asked for and another program was faster.
"""

import dataclasses
import errno
import ipaddress
import socket

__all__ = ["Address", "find_address"]

_FIRST_PORT = 8080
_PORTS = 100  # how many to try after the first


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
    number = _number(host)
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


def _number(host: str) -> str:
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
    for port in range(first, min(first + _PORTS, 65536)):
        if _refusal(host, port) is None:
            return port
    with _socket(host) as any_port:
        any_port.bind((host, 0))
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
    made = _socket(host)
    try:
        made.bind((host, port))
        made.listen()
    except OSError:
        made.close()
        raise
    return made


def _socket(host: str) -> socket.socket:
    made = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    if host == "::":  # all networks, those of IPv4 too
        made.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
    return made
