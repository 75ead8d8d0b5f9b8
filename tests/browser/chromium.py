"""A headless Chromium for tests, driven over the DevTools protocol through two pipes.

    with Chromium(tmp_path) as browser:
        page = browser.open(path.as_uri())
        assert page.evaluate("document.title") == "..."
        assert page.errors == []
        assert page.requests == [path.as_uri()]

It needs the program and nothing else: no driver, no port and no package. Everything that the page
loads and complains of is recorded, from its first byte on.
"""

import base64
import contextlib
import json
import os
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

__all__ = ["SOFTWARE_WEBGL", "Chromium", "NavigatedError", "Page"]

# Flags without which it refuses to draw WebGL where there is no graphics card.
SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
_LIMIT = 180.0  # seconds for anything, on the slowest machine too
_POLL = 0.05  # seconds
_NAVIGATED = "Inspected target navigated or closed"  # Chromium's message
_FLAGS = (
    "--headless",
    "--remote-debugging-pipe",
    # It speaks to nobody but the test.
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-domain-reliability",
    "--disable-quic",
    "--disable-sync",
    "--no-default-browser-check",
    "--no-first-run",
    # A machine without a display or a graphics card, in a container with little /dev/shm.
    "--autoplay-policy=no-user-gesture-required",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--mute-audio",
)
# Chromium reads from descriptor 3 and writes to 4.
_START = """
import fcntl, os, sys
pipes = [fcntl.fcntl(int(pipe), fcntl.F_DUPFD, 10) for pipe in sys.argv[1:3]]
for number, pipe in enumerate(pipes, start=3):
    os.dup2(pipe, number)
    os.close(pipe)
os.execv(sys.argv[3], sys.argv[3:])
"""
# Messages that carry what a page complains of, and where in them it stands.
_COMPLAINTS = {
    "Runtime.exceptionThrown": "exceptionDetails",
    "Log.entryAdded": "entry",
}


class NavigatedError(Exception):
    """The page went elsewhere before it had answered."""


class Chromium:
    """A browser with a profile of its own; skips the test where there is none."""

    def __init__(self, directory: Path, *flags: str) -> None:
        """Starts it.

        Args:
          directory: for its profile.
          flags: more of the command line.
        """
        program = next(filter(None, map(shutil.which, _PROGRAMS)), None)
        if program is None:
            pytest.skip(f"no browser here: none of {', '.join(_PROGRAMS)} is installed")
        theirs, self._send = os.pipe()
        self._receive, answers = os.pipe()
        # Root cannot have Chromium's sandbox. The pages opened here are the tests' own.
        sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
        profile = f"--user-data-dir={directory / 'profile'}"
        start = [sys.executable, "-c", _START, str(theirs), str(answers)]
        self._process = subprocess.Popen(
            [*start, program, *_FLAGS, *sandbox, profile, *flags, "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(theirs, answers),
            start_new_session=True,
        )
        os.close(theirs)
        os.close(answers)
        self._unread = b""
        self._calls = 0
        self._events: list[dict[str, Any]] = []

    def __enter__(self) -> "Chromium":
        return self

    def __exit__(self, *error: object) -> None:
        os.close(self._send)  # without its pipe it ends
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._receive)

    def open(
        self, address: str, width: int = 1280, height: int = 900, scale: float = 1.0
    ) -> "Page":
        """A page in a tab of its own, loaded.

        Args:
          address: such as `path.as_uri()`.
          width: of the window, CSS pixels.
          height: of the window, CSS pixels.
          scale: pixels that are drawn per CSS pixel.
        """
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        page = Page(self, attached["sessionId"])
        for domain in ("Page", "Runtime", "Log", "Network"):
            page.call(f"{domain}.enable")
        page.resize(width, height, scale)
        page.call("Page.navigate", url=address)
        page.wait_for("document.readyState == 'complete' && location.href != 'about:blank'")
        return page

    def call(self, method: str, session: str | None = None, **arguments: Any) -> dict[str, Any]:
        """The answer to a call of the DevTools protocol; fails if it is an error."""
        self._calls += 1
        message = {"id": self._calls, "method": method, "params": arguments}
        if session is not None:
            message["sessionId"] = session
        content = json.dumps(message).encode() + b"\0"
        while content:
            content = content[os.write(self._send, content) :]
        while True:
            answer = self._next_message()
            if answer.get("id") == self._calls:
                error = answer.get("error")
                if error and error["message"] == _NAVIGATED:
                    raise NavigatedError(f"{method}: the page went elsewhere before its answer")
                assert not error, f"{method}: {error}"
                return answer["result"]
            self._events.append(answer)

    def events_of(self, session: str) -> list[dict[str, Any]]:
        """The protocol's events of a page so far."""
        return [event for event in self._events if event.get("sessionId") == session]

    def _next_message(self) -> dict[str, Any]:
        end = time.monotonic() + _LIMIT
        while b"\0" not in self._unread:
            ready, _, _ = select.select([self._receive], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"Chromium said nothing for {_LIMIT:g} seconds"
            read = os.read(self._receive, 1 << 20)
            assert read, f"Chromium has ended, with status {self._process.wait(10)}"
            self._unread += read
        message, self._unread = self._unread.split(b"\0", 1)
        return json.loads(message)


class Page:
    """A page in a tab."""

    def __init__(self, browser: Chromium, session: str) -> None:
        """Takes the tab that a session of the protocol belongs to."""
        self._browser = browser
        self._session = session

    def call(self, method: str, **arguments: Any) -> dict[str, Any]:
        """The answer to a call of the DevTools protocol about this page."""
        return self._browser.call(method, self._session, **arguments)

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression in the page, awaited if it is a promise."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait_for(self, expression: str) -> None:
        """Waits until a JavaScript expression is true; fails after a minute."""
        end = time.monotonic() + _LIMIT
        is_true = False
        while not is_true:
            assert time.monotonic() < end, f"not true after {_LIMIT:g} seconds: {expression}"
            with contextlib.suppress(NavigatedError):  # as after a click: ask the next page
                is_true = self.evaluate(f"Boolean({expression})")
            if not is_true:
                time.sleep(_POLL)

    def wait_for_frames(self, count: int) -> None:
        """Waits until the page has drawn so many times."""
        self.evaluate(
            f"new Promise(done => {{ let left = {count}; const next = () =>"
            " left-- > 0 ? requestAnimationFrame(next) : done(true); next(); })"
        )

    def resize(self, width: int, height: int, scale: float = 1.0) -> None:
        """Gives the page a window of so many pixels."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=scale,
            mobile=width < 600,
        )

    def prefer(self, **features: str) -> None:
        """Sets media features, with `_` for `-`: `prefer(prefers_color_scheme="dark")`."""
        wanted = [{"name": k.replace("_", "-"), "value": v} for k, v in features.items()]
        self.call("Emulation.setEmulatedMedia", features=wanted)

    def screenshot(self, path: Path, whole: bool = True) -> None:
        """Writes a PNG of the whole page, or of what the window shows."""
        answer = self.call("Page.captureScreenshot", captureBeyondViewport=whole, format="png")
        path.write_bytes(base64.b64decode(answer["data"]))

    def click(self, x: float, y: float) -> None:
        """Clicks with the left button at a point of the window, pixels."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    @property
    def requests(self) -> list[str]:
        """The addresses that the page has asked for, but for data within itself."""
        self.evaluate("0")  # what has happened so far is read before its answer
        return [
            event["params"]["request"]["url"]
            for event in self._browser.events_of(self._session)
            if event["method"] == "Network.requestWillBeSent"
            and not event["params"]["request"]["url"].startswith(("data:", "blob:"))
        ]

    @property
    def websockets(self) -> list[str]:
        """The addresses of the WebSockets that the page has opened and that were accepted."""
        self.evaluate("0")
        urls: dict[str, str] = {}
        accepted = []
        for event in self._browser.events_of(self._session):
            params = event["params"]
            if event["method"] == "Network.webSocketCreated":
                urls[params["requestId"]] = params["url"]
            elif event["method"] == "Network.webSocketHandshakeResponseReceived":
                accepted += [urls[params["requestId"]]] * (params["response"]["status"] == 101)
        return accepted

    @property
    def errors(self) -> list[Any]:
        """The page's complaints: exceptions, errors and warnings in its console."""
        self.evaluate("0")
        events = self._browser.events_of(self._session)
        found = [
            e["params"][_COMPLAINTS[e["method"]]] for e in events if e["method"] in _COMPLAINTS
        ]
        said = (e["params"] for e in events if e["method"] == "Runtime.consoleAPICalled")
        return found + [call for call in said if call["type"] in ("error", "warning", "assert")]
