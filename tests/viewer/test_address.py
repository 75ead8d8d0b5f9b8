"""The web viewer's address: which ports are free, and taking one."""

import errno
import socket

import pytest

from limberjack.viewer.address import Address, find_address


def _listening(host: str) -> socket.socket:
    """A socket that has taken a port."""
    taken = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
    taken.bind((host, 0))
    taken.listen()
    return taken


def test_by_default_no_other_machine_can_reach_it() -> None:
    address = find_address()
    assert address.host == "127.0.0.1"
    assert address.is_local
    assert address.port >= 8080
    assert address.url == f"http://127.0.0.1:{address.port}/"


def test_a_port_in_use_is_refused_with_one_that_is_free() -> None:
    with _listening("127.0.0.1") as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ValueError, match=rf"^port {port} is in use; port \d+ is free$") as info:
            find_address(port=port)
        free = int(str(info.value).split()[-3])
        assert free != port
        assert find_address(port=free) == Address("127.0.0.1", free)
    assert find_address(port=port) == Address("127.0.0.1", port)


def test_a_port_that_another_listens_to_on_all_networks_is_in_use() -> None:
    with _listening("0.0.0.0") as taken, pytest.raises(ValueError, match="is in use"):
        find_address(port=taken.getsockname()[1])


def test_ports_in_use_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with _listening("127.0.0.1") as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr("limberjack.viewer.address._FIRST_PORT", port)
        assert find_address().port != port


@pytest.mark.parametrize("port", [0, -1, 65536])
def test_what_is_no_port_is_refused(port: int) -> None:
    with pytest.raises(ValueError, match=f"port is {port}; expected 1 to 65535"):
        find_address(port=port)


# 192.0.2.1 is reserved for documentation, and .invalid for names that do not exist.
@pytest.mark.parametrize("host", ["192.0.2.1", "nowhere.invalid", "", "a" * 300])
def test_a_host_that_is_not_this_machine_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match="is not an address of this machine; expected 127"):
        find_address(host)


def test_names_and_all_networks_are_understood() -> None:
    assert find_address("localhost").is_local
    everywhere = find_address("0.0.0.0")
    assert not everywhere.is_local
    assert everywhere.url == f"http://localhost:{everywhere.port}/"
    assert Address("::1", 80).url == "http://[::1]:80/"


def test_a_port_that_was_not_asked_for_gives_way_to_the_next() -> None:
    with _listening("127.0.0.1") as taken:
        port = taken.getsockname()[1]
        with Address("127.0.0.1", port, is_fixed=False).listen() as listening:
            assert listening.getsockname()[1] != port
            socket.create_connection(listening.getsockname(), timeout=60).close()
        with pytest.raises(OSError, match="in use") as info:
            Address("127.0.0.1", port).listen()
    assert info.value.errno == errno.EADDRINUSE
    assert not find_address().is_fixed


def test_viewers_that_start_at_the_same_time_get_ports_of_their_own() -> None:
    first, second = find_address(), find_address()
    assert first == second  # neither has taken it
    with first.listen() as one, second.listen() as other:
        assert one.getsockname() == (first.host, first.port)
        assert other.getsockname() != one.getsockname()


@pytest.mark.skipif(not socket.has_ipv6, reason="this Python has no IPv6")
def test_all_networks_of_ipv6_are_those_of_ipv4_too() -> None:
    try:
        address = find_address("::")
    except ValueError:
        pytest.skip("this machine has no IPv6")
    with address.listen() as listening:
        port = listening.getsockname()[1]
        for host in ("127.0.0.1", "::1"):
            socket.create_connection((host, port), timeout=60).close()
