"""The viewer among other pages of a real browser: its own page gets in, and no other."""

import contextlib
import http.server
import socket
import socketserver
import threading
import urllib.parse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from .chromium import SOFTWARE_WEBGL, Chromium, Page
from .viewing import serving, wait

pytestmark = pytest.mark.browser

pytest.importorskip(
    "limberjack.viewer.studio", reason="MuJoCo Studio is not installed", exc_type=ImportError
)

_VIEW = ["-m", "limberjack", "view", "humanoid", "stand"]
_SIZE = (160, 120)  # pixels; few, as they are drawn without a graphics card
_REBOUND = "evil.example"  # a name that the browser resolves to this machine


class _Viewer(NamedTuple):
    """A viewer that the browser has opened."""

    address: str  # with the token
    page: Page

    @property
    def host(self) -> str:
        return urllib.parse.urlsplit(self.address).netloc


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    rebound = f"--host-resolver-rules=MAP {_REBOUND} 127.0.0.1"
    with Chromium(tmp_path_factory.mktemp("browser"), *SOFTWARE_WEBGL, rebound) as browser:
        yield browser


@pytest.fixture(scope="module")
def viewer(browser: Chromium, tmp_path_factory: pytest.TempPathFactory) -> Iterator[_Viewer]:
    with serving(_VIEW, tmp_path_factory.mktemp("view")) as address:
        yield _Viewer(address, browser.open(address, *_SIZE))


class _Blank(http.server.BaseHTTPRequestHandler):
    """A page of somebody else's, with nothing in it."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<!doctype html><title>other</title>")

    def log_request(self, code: object = "-", size: object = "-") -> None:
        pass


@pytest.fixture(scope="module")
def other(browser: Chromium, viewer: _Viewer) -> Iterator[Page]:
    """A page on another port of the same host: the browser sends it the viewer's cookie."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Blank) as server:
        threading.Thread(target=server.serve_forever).start()
        yield browser.open(f"http://127.0.0.1:{server.server_port}/", *_SIZE)
        server.shutdown()


def _opens(page: Page, host: str, path: str) -> bool:
    """Whether a WebSocket that the page opens is accepted."""
    return page.evaluate(
        f"""new Promise(done => {{
            const socket = new WebSocket("ws://{host}{path}?sid=test");
            socket.onopen = () => {{ done(true); socket.close(); }};
            socket.onerror = () => done(false);
        }})"""
    )


def _fetches(page: Page, url: str, options: str = "{}") -> bool:
    """Whether the page gets an answer that is no error."""
    return page.evaluate(
        f"fetch({url!r}, {options}).then(r => r.ok || r.type === 'opaque', () => false)"
    )


def _works(page: Page, host: str) -> bool:
    return _fetches(page, f"http://{host}/model") and _opens(page, host, "/state")


def test_the_viewer_s_own_page_reads_the_model_and_opens_websockets(viewer: _Viewer) -> None:
    assert _works(viewer.page, viewer.host)
    assert not _opens(viewer.page, viewer.host, "/drop")


def test_its_scripts_cannot_read_the_cookie(viewer: _Viewer) -> None:
    assert viewer.page.evaluate("document.cookie") == ""


@pytest.mark.parametrize("path", ["/ui", "/state", "/drop"])
def test_another_page_opens_no_websocket(viewer: _Viewer, other: Page, path: str) -> None:
    assert other.evaluate("document.title") == "other"
    assert not _opens(other, viewer.host, path)


@pytest.mark.parametrize("options", ["{}", "{credentials: 'include'}", "{mode: 'no-cors'}"])
def test_another_page_reads_nothing(viewer: _Viewer, other: Page, options: str) -> None:
    for path in ("/", "/model", "/web_client.js"):
        assert not _fetches(other, f"http://{viewer.host}{path}", options)
    own = other.evaluate("location.href")
    assert _fetches(other, own, options)  # what it may


def test_another_page_cannot_load_a_script_of_the_viewer(viewer: _Viewer, other: Page) -> None:
    loaded = other.evaluate(
        f"""new Promise(done => {{
            const script = document.createElement("script");
            script.src = "http://{viewer.host}/web_client.js";
            script.onload = () => done(true);
            script.onerror = () => done(false);
            document.head.append(script);
        }})"""
    )
    assert loaded is False


def test_a_foreign_name_for_this_machine_is_refused(browser: Chromium, viewer: _Viewer) -> None:
    foreign = viewer.address.replace("127.0.0.1", _REBOUND)
    page = browser.open(foreign, *_SIZE)
    text = page.evaluate("document.body.innerText")
    host = urllib.parse.urlsplit(foreign).netloc
    assert text.startswith(f"limberjack: Host is '{host}'; expected localhost")
    assert not _works(page, host)


def test_without_the_token_the_page_says_what_to_open(browser: Chromium, viewer: _Viewer) -> None:
    # The cookie is 127.0.0.1's, so under this name the browser has none.
    bare = viewer.address.partition("?")[0].replace("127.0.0.1", "localhost")
    page = browser.open(bare, *_SIZE)
    text = page.evaluate("document.body.innerText")
    assert "open the address that the viewer printed" in text


class _Forward(socketserver.BaseRequestHandler):
    """Passes bytes on to a port and back, as `ssh -L` does."""

    to = 0

    def handle(self) -> None:
        with socket.create_connection(("127.0.0.1", self.to)) as there:
            back = threading.Thread(target=self._copy, args=(there, self.request))
            back.start()
            self._copy(self.request, there)
            back.join()

    @staticmethod
    def _copy(source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                target.sendall(data)
        for end in (source, target):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)


def test_a_tunnel_from_another_port_works(browser: Chromium, viewer: _Viewer) -> None:
    port = int(viewer.host.partition(":")[2])
    forward = type("Forward", (_Forward,), {"to": port})
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), forward) as tunnel:
        tunnel.daemon_threads = True
        threading.Thread(target=tunnel.serve_forever).start()
        host = f"localhost:{tunnel.server_address[1]}"
        page = browser.open(viewer.address.replace(viewer.host, host), *_SIZE)
        works = _works(page, host)
        page.call("Page.close")
        tunnel.shutdown()
    assert works


def test_two_viewers_at_once_work_in_one_browser(
    browser: Chromium, viewer: _Viewer, tmp_path: Path
) -> None:
    with serving(_VIEW, tmp_path) as address:
        second = _Viewer(address, browser.open(address, *_SIZE))
        assert second.host != viewer.host
        for one in (viewer, second):
            for path in ("/ui", "/state"):  # which the page opens by itself
                wait(lambda start=f"ws://{one.host}{path}", page=one.page: _has(page, start))
        assert second.page.errors == []
        for one, another in ((viewer, second), (second, viewer)):
            assert _works(one.page, one.host)
            assert not _opens(one.page, another.host, "/state")
        second.page.call("Page.close")


def _has(page: Page, start: str) -> bool:
    return any(url.startswith(start) for url in page.websockets)


def test_the_viewer_s_page_was_not_disturbed(viewer: _Viewer, other: Page) -> None:
    viewer.page.call("Page.reload")
    viewer.page.wait_for("document.readyState == 'complete'")
    assert _works(viewer.page, viewer.host)
