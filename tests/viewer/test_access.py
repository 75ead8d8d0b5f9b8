"""The viewer's rules: hosts, origins, the token and its cookie."""

import errno
import socket

import pytest

from limberjack.viewer.access import Access, Address, Request, find_address

_LOCAL = Address("127.0.0.1", 8080)
_EVERYWHERE = Address("0.0.0.0", 8080)
_ADDRESS = "192.0.2.7"  # of this machine, in a network


def _request(
    access: Access,
    path: str = "/state",
    host: str = "localhost:8080",
    *more: tuple[str, str],
    arrived_at: str = "127.0.0.1",
    method: str = "GET",
) -> Request:
    """A request with the cookie that the browser of that host and port would send."""
    port = host.rpartition(":")[2] if host.rpartition(":")[2].isdecimal() else "8080"
    cookie = ("Cookie", f"other=1; limberjack-{port}={access.token}; last=2")
    return Request(method, path, [("Host", host), cookie, *more], arrived_at)


@pytest.mark.parametrize(
    "host",
    [
        "localhost:8080",
        "LOCALHOST:8080",
        "localhost",
        "127.0.0.1:8080",
        "127.9.9.9:80",
        "[::1]:8080",
    ],
)
def test_this_machine_s_names_are_answered_with_any_port(host: str) -> None:
    access = Access(_LOCAL)
    assert access.refusal(_request(access, host=host)) is None


@pytest.mark.parametrize(
    "host",
    [
        "evil.example", "evil.example:8080", "localhost.evil.example", "evil.example@localhost",
        "127.0.0.1.evil.example", "0.0.0.0:8080", "[::]:8080", _ADDRESS, "2130706433", "127.1",
        "", ":8080", "localhost:", "localhost:8080:8080", "localhost, evil.example", "[localhost]",
        "localhost:123456", "localhost/", "localhost\t", "[::1", "::1",
    ],
)  # fmt: skip
def test_other_names_are_refused(host: str) -> None:
    access = Access(_LOCAL)
    refusal = access.refusal(_request(access, host=host))
    assert refusal is not None
    assert refusal.startswith(f"Host is {host!r}; expected localhost")
    assert "--allow-host NAME" in refusal


def test_a_request_without_a_host_or_with_two_is_refused() -> None:
    access = Access(_LOCAL)
    cookie = ("Cookie", f"limberjack-8080={access.token}")
    local = ("Host", "localhost:8080")
    assert access.refusal(Request("GET", "/", [local, cookie], "127.0.0.1")) is None
    for hosts in ([], [local, local], [local, ("host", "evil.example")]):
        refusal = access.refusal(Request("GET", "/", [*hosts, cookie], "127.0.0.1"))
        assert refusal is not None
        assert refusal.startswith("Host is ")


def test_an_address_of_the_machine_is_answered_where_the_viewer_listens_on_it() -> None:
    bound = Access(Address(_ADDRESS, 8080))
    assert bound.refusal(_request(bound, host=f"{_ADDRESS}:8080")) is None
    assert bound.refusal(_request(bound, host="192.0.2.8:8080")) is not None
    everywhere = Access(_EVERYWHERE)
    for host, arrived_at, is_answered in [
        (_ADDRESS, _ADDRESS, True),
        (_ADDRESS, f"::ffff:{_ADDRESS}", True),
        ("[2001:db8::7]", "2001:db8::7", True),
        ("192.0.2.8", _ADDRESS, False),
        ("0.0.0.0", _ADDRESS, False),
        ("localhost", "127.0.0.1", True),
    ]:
        request = _request(everywhere, host=host, arrived_at=arrived_at)
        assert (everywhere.refusal(request) is None) == is_answered, host


def test_names_that_are_allowed_are_answered_and_no_others() -> None:
    access = Access(_LOCAL, ["viewer.example.org", "Other.Example", "192.0.2.9"])
    for host in ("viewer.example.org", "viewer.example.org:443", "other.example", "192.0.2.9:80"):
        assert access.refusal(_request(access, host=host)) is None
    for host in ("example.org", "a.viewer.example.org", "viewerxexample.org"):
        assert access.refusal(_request(access, host=host)) is not None


@pytest.mark.parametrize(
    "name", ["", "*", "https://a.example", "a.example:80", "a.example/x", "a example"]
)
def test_an_allowed_host_that_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"expected a name such as viewer\.example\.org"):
        Access(_LOCAL, [name])


def test_one_name_instead_of_a_list_is_refused() -> None:
    with pytest.raises(TypeError, match=r"expected a list: \['viewer.example.org'\]"):
        Access(_LOCAL, "viewer.example.org")


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("localhost:8080", "http://localhost:8080"),
        ("localhost:9999", "http://localhost:9999"),  # a tunnel from another port
        ("localhost", "http://localhost"),
        ("localhost:80", "http://localhost"),
        ("viewer.example.org", "https://viewer.example.org"),
        ("viewer.example.org:443", "https://viewer.example.org"),
        ("[::1]:8080", "http://[::1]:8080"),
    ],
)
def test_the_viewer_s_own_page_is_answered(host: str, origin: str) -> None:
    access = Access(_LOCAL, ["viewer.example.org"])
    assert access.refusal(_request(access, "/ui", host, ("Origin", origin))) is None


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example", "http://evil.example:8080", "http://localhost:9000",
        "http://127.0.0.1:8080", "http://localhost", "https://localhost", "null", "",
        "localhost:8080",
        "http://localhost:8080.evil.example", "http://localhost:8080/", "file://",
        "chrome-extension://localhost:8080", "http://localhost:8080 http://evil.example",
    ],
)  # fmt: skip
def test_other_pages_are_refused_with_the_right_cookie_too(origin: str) -> None:
    access = Access(_LOCAL)
    refusal = access.refusal(_request(access, "/ui", "localhost:8080", ("Origin", origin)))
    assert refusal == f"Origin is {origin!r}; expected the viewer's own page, at 'localhost:8080'"


def test_a_second_origin_does_not_hide_the_first() -> None:
    access = Access(_LOCAL)
    own, other = ("Origin", "http://localhost:8080"), ("Origin", "http://evil.example")
    for pair in ((own, other), (other, own)):
        assert access.refusal(_request(access, "/ui", "localhost:8080", *pair)) is not None


@pytest.mark.parametrize("path", ["/drop", "/drop?sid=1"])
def test_uploads_are_refused(path: str) -> None:
    access = Access(_LOCAL)
    refusal = access.refusal(_request(access, path))
    assert refusal == "files are refused: the viewer shows one environment"


def test_only_plain_get_requests_are_answered() -> None:
    access = Access(_LOCAL)
    for method in ("POST", "PUT", "HEAD", "OPTIONS", "get"):
        assert access.refusal(_request(access, method=method)) is not None
    for path in ("http://localhost:8080/drop", "*", ""):
        assert access.refusal(_request(access, path)) is not None


def test_without_the_token_nothing_is_answered() -> None:
    access, other = Access(_LOCAL), Access(_LOCAL)
    assert len(access.token) > 40
    assert access.token != other.token
    for token in ("", "x", other.token, access.token[:-1], f"{access.token}x", "é"):
        headers = [("Host", "localhost:8080"), ("Cookie", f"limberjack-8080={token}")]
        for path in ("/", "/ui", "/state", "/model", f"/?token={other.token}", "/?token="):
            refusal = access.refusal(Request("GET", path, headers, "127.0.0.1"))
            assert refusal is not None
            assert "open the address that the viewer printed" in refusal
            assert access.token not in refusal


def test_the_printed_address_brings_the_token_to_the_page_and_to_nothing_else() -> None:
    access = Access(_LOCAL)
    prefix = "http://127.0.0.1:8080"
    assert access.url == f"{prefix}/?token={access.token}"
    host = [("Host", "127.0.0.1:8080")]
    page = Request("GET", access.url.removeprefix(prefix), host, "127.0.0.1")
    assert access.refusal(page) is None
    cookie = f"limberjack-8080={access.token}; Path=/; HttpOnly; SameSite=Strict"
    assert access.cookie(page) == cookie
    for path in (f"/ui?token={access.token}", f"/?token={access.token}&token=x"):
        request = Request("GET", path, host, "127.0.0.1")
        assert access.refusal(request) is not None
        assert access.cookie(request) is None


def test_the_cookie_s_name_has_the_port_that_the_browser_uses() -> None:
    access = Access(_LOCAL)
    for host, port in (("localhost:9999", 9999), ("localhost", 8080)):
        page = Request("GET", f"/?token={access.token}", [("Host", host)], "127.0.0.1")
        cookie = access.cookie(page)
        assert cookie is not None
        assert cookie.startswith(f"limberjack-{port}=")
        sent = [("Host", host), ("Cookie", cookie.partition(";")[0])]
        assert access.refusal(Request("GET", "/ui", sent, "127.0.0.1")) is None


def test_cookies_of_other_programs_on_the_machine_do_not_matter() -> None:
    access = Access(_LOCAL)
    name = "limberjack-8080"
    for text in (
        f'bad"[]=x; {name}={access.token}',
        f"{name}=old; {name}={access.token}",
        f"alone;;{name}={access.token}",
    ):
        headers = [("Host", "localhost:8080"), ("Cookie", text)]
        assert access.refusal(Request("GET", "/ui", headers, "127.0.0.1")) is None
    parted = [("Host", "localhost:8080"), ("Cookie", "a=b"), ("Cookie", f"{name}={access.token}")]
    assert access.refusal(Request("GET", "/ui", parted, "127.0.0.1")) is None


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


@pytest.mark.parametrize(("system", "is_shared"), [("posix", True), ("nt", False)])
def test_a_port_is_not_shared_with_another_program_on_windows(
    monkeypatch: pytest.MonkeyPatch, system: str, is_shared: bool
) -> None:
    address = find_address()
    with monkeypatch.context() as elsewhere:
        elsewhere.setattr("os.name", system)
        made = address.listen()
    with made:
        option = made.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)
    assert (option != 0) == is_shared


def test_ports_in_use_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    with _listening("127.0.0.1") as taken:
        port = taken.getsockname()[1]
        monkeypatch.setattr("limberjack.viewer.access._FIRST_PORT", port)
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
