"""Delays of the viewer's answers to keys, panel and mouse, in a browser with software WebGL.

    python benchmarks/viewer.py [--quick] [--tries N] [--json FILE]

Each try does what a person does, one after the other: pause, step, reset, begin a chosen seed,
change the speed, and go on. Then a body is selected, and pushed as often. Measured are the
milliseconds from the event in the browser until the session has done it, and until the page has
drawn two pictures after that. Keys are held until then, as Studio looks at them once for each of
its frames. It needs Chromium.
The exit status is 1 if a median misses its bar. Run it on an idle machine.
"""

import contextlib
import dataclasses
import itertools
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer
from report import Json, Quick, Row, at_most, finish, spread

sys.path.append(str(Path(__file__).parents[1]))  # the browser is that of the tests

from tests.browser.chromium import SOFTWARE_WEBGL, Chromium, Page
from tests.browser.viewing import serving

__all__ = ["main"]

_BAR = at_most(300)  # milliseconds
_WIDTH, _HEIGHT, _SCALE = 640, 400, 0.5  # CSS pixels of the page; pixels drawn per CSS pixel
_LIMIT = 60.0  # seconds for anything
_LIMIT_TO_CHOOSE = 300.0  # for double clicks, which a busy machine takes for single ones
_POLL = 0.002  # seconds
_SETTLED = 2.0  # seconds until nothing is under way any more
_FRAMES = 2  # after which a picture surely shows what has been done
_PAUSE = 0.4  # seconds between two clicks, which would be a double click otherwise
_PLUS, _BEGIN_SEED = (239, 162), (300, 162)  # places in the panel, CSS pixels
_PLACE = (396, 112)  # CSS pixels, beside the panel; the spinner of the finger is seen there
_DRAG = 40  # CSS pixels
_CTRL = 2  # the DevTools protocol's number of the modifier
# The protocol's key, code and number.
_KEYS = {
    "pause": (" ", "Space", 32),
    "run": (" ", "Space", 32),
    "step": ("ArrowRight", "ArrowRight", 39),
    "reset": ("Backspace", "Backspace", 8),
    "speed": ("-", "Minus", 189),
    "speed again": ("=", "Equal", 187),
}

# A session that writes what it was asked for, and when.
_PROGRAM = """
import sys, time
from limberjack import suite, viewer
from limberjack.viewer.access import Access, find_address
from limberjack.viewer.session import Session

class Noting(Session):
    def note(self, what):
        print(what, time.monotonic(), file=file)

    def pause(self, paused=True):
        before = self.paused
        super().pause(paused)
        if before != self.paused:
            self.note("pause" if self.paused else "run")

    def step(self):
        super().step()
        if self.paused:
            self.note("step")

    def reset(self):
        super().reset()
        self.note("reset")

    def begin(self, seed):
        super().begin(seed)
        self.note("seed")

    def set_speed(self, speed):
        before = getattr(self, "_speed", speed)
        super().set_speed(speed)
        if before != speed:
            self.note("speed")

    def push(self, forces):
        super().push(forces)
        if forces.any():
            self.note("push")

file = open("noted", "w", buffering=1)
quality, *task = sys.argv[1:]
environment = suite.load(*task)
show = viewer.in_browsers(Access(find_address()), "view", lambda url: print(url, flush=True))
show(Noting(environment, seed=0, quality=quality))
"""


@dataclasses.dataclass(frozen=True)
class _Scene:
    """View to measure."""

    title: str
    task: tuple[str, str]
    has_body: bool  # at _PLACE, to push
    quality: str


_CARTPOLE = ("cartpole", "swingup")
_SCENES = (
    _Scene("finger spin", ("finger", "spin"), True, "auto"),
    _Scene("cartpole swingup", _CARTPOLE, False, "auto"),
    _Scene("cartpole swingup, full", _CARTPOLE, False, "full"),
)


class _Viewed:
    """A page of the viewer, and when its session did what."""

    def __init__(self, page: Page, directory: Path) -> None:
        self._page, self._noted = page, directory / "noted"
        self.done: dict[str, list[float]] = {}  # milliseconds until the session has done it
        self.drawn: dict[str, list[float]] = {}  # and until the page has drawn it

    def begin(self) -> None:
        """Presses Space until the page answers and the session runs again."""
        self._answered("pause", 0.0, again=lambda: self._press("pause"))
        time.sleep(_SETTLED)
        while "run" not in self._noted.read_text().splitlines()[-1]:
            self._press("run")
            time.sleep(_SETTLED)

    def try_keys_and_panel(self) -> None:
        """Does each thing once, but no push."""
        for what in ("pause", "step", "reset"):
            self._measure(what, *self._key(what))
        self._click(_PLUS)
        time.sleep(_PAUSE)
        self._move(*_BEGIN_SEED)
        self._button("mousePressed", _BEGIN_SEED)
        self._page.wait_for_frames(_FRAMES)
        self._measure("seed", lambda: self._button("mouseReleased", _BEGIN_SEED))
        self._move(*_PLACE)  # away from the panel, which has the keys else
        for what in ("speed", "run"):
            self._measure(what, *self._key(what))
        self._press("speed again")

    def try_push(self) -> None:
        """Pushes the body that was chosen."""
        with self._dragging() as drag:
            self._measure("push", drag)

    def milliseconds_of_frame(self) -> float:
        """Time from one picture of the page to the next."""
        began = time.monotonic()
        self._page.wait_for_frames(10 * _FRAMES)
        return 1e3 * (time.monotonic() - began) / (10 * _FRAMES)

    def _measure(
        self, what: str, act: Callable[[], None], end: Callable[[], None] = lambda: None
    ) -> None:
        began = time.monotonic()
        act()
        done = self._answered(what, began)
        self._page.wait_for_frames(_FRAMES)
        self.done.setdefault(what, []).append(1e3 * (done - began))
        self.drawn.setdefault(what, []).append(1e3 * (time.monotonic() - began))
        end()
        self._page.wait_for_frames(_FRAMES)

    def _answered(self, what: str, began: float, again: Callable[[], None] = lambda: None) -> float:
        """Time at which the session first did something after a moment; tries again until then."""
        end = time.monotonic() + _LIMIT
        while time.monotonic() < end:
            moment = self._moment(what, began)
            if moment is not None:
                return moment
            again()
            time.sleep(_POLL)
        raise SystemExit(f"{what}: no answer in {_LIMIT:g} seconds")

    def _moment(self, what: str, began: float) -> float | None:
        """The time at which the session first did something after a moment; None if it has not."""
        lines = self._noted.read_text().splitlines(keepends=True)
        noted = [line.split() for line in lines if line.endswith("\n")]
        moments = (float(moment) for name, moment in noted if name == what)
        return next((moment for moment in moments if moment > began), None)

    def _key(self, what: str) -> tuple[Callable[[], None], Callable[[], None]]:
        """Functions that hold a key down, and let it go."""
        key, code, number = _KEYS[what]
        about = {"key": key, "code": code, "windowsVirtualKeyCode": number}

        def dispatch(kind: str) -> None:
            self._page.call("Input.dispatchKeyEvent", type=kind, **about)

        return lambda: dispatch("rawKeyDown"), lambda: dispatch("keyUp")

    def _press(self, what: str) -> None:
        for half in self._key(what):
            half()
            self._page.wait_for_frames(_FRAMES)

    def _click(self, place: tuple[int, int]) -> None:
        self._move(*place)
        for kind in ("mousePressed", "mouseReleased"):
            self._button(kind, place)
            self._page.wait_for_frames(_FRAMES)

    def _button(self, kind: str, place: tuple[int, int]) -> None:
        self._mouse(kind, *place, button="left", clickCount=1)

    def choose(self) -> None:
        """Double clicks on the body until it can be pushed."""
        end = time.monotonic() + _LIMIT_TO_CHOOSE
        # Held for a picture, a press is surely seen, but two may be too far apart for a double
        # click where pictures take long.
        for frames in itertools.cycle((1, 0)):
            for _ in range(2):
                for kind in ("mousePressed", "mouseReleased"):
                    self._button(kind, _PLACE)
                    self._page.wait_for_frames(frames)
            began = time.monotonic()
            with self._dragging() as drag:
                drag()
                time.sleep(_SETTLED)
            if self._moment("push", began) is not None:
                return
            if time.monotonic() > end:
                raise SystemExit(f"no body was chosen in {_LIMIT_TO_CHOOSE:g} seconds")

    @contextlib.contextmanager
    def _dragging(self) -> Iterator[Callable[[], None]]:
        """Holds Ctrl and the right button on the body; gives a function that moves the mouse."""
        x, y = _PLACE
        about = {"code": "ControlLeft", "key": "Control", "windowsVirtualKeyCode": 17}
        self._page.call("Input.dispatchKeyEvent", type="rawKeyDown", modifiers=_CTRL, **about)
        held = {"button": "right", "buttons": 2, "modifiers": _CTRL}
        self._move(x, y, modifiers=_CTRL)
        self._mouse("mousePressed", x, y, clickCount=1, **held)
        self._page.wait_for_frames(_FRAMES)
        yield lambda: self._mouse("mouseMoved", x, y - _DRAG, **held)
        self._mouse("mouseReleased", x, y - _DRAG, button="right", modifiers=_CTRL, clickCount=1)
        self._page.call("Input.dispatchKeyEvent", type="keyUp", **about)
        self._page.wait_for_frames(_FRAMES)

    def _move(self, x: int, y: int, **about: object) -> None:
        self._mouse("mouseMoved", x, y, **about)
        self._page.wait_for_frames(_FRAMES)

    def _mouse(self, kind: str, x: int, y: int, **about: object) -> None:
        self._page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **about)


def _rows(scene: _Scene, tries: int, directory: Path) -> list[Row]:
    with (
        Chromium(directory, *SOFTWARE_WEBGL) as browser,
        serving(["-c", _PROGRAM, scene.quality, *scene.task], directory) as address,
    ):
        viewed = _Viewed(browser.open(address, _WIDTH, _HEIGHT, _SCALE), directory)
        viewed.begin()
        for _ in range(tries):
            viewed.try_keys_and_panel()
        frame = viewed.milliseconds_of_frame()
        if scene.has_body:
            viewed.choose()
            for _ in range(tries):
                viewed.try_push()
    rows = [Row("a frame of the page", scene.title, frame, None, "ms", frame)]
    for what, drawn in viewed.drawn.items():
        done, median = viewed.done[what], statistics.median(drawn)
        details = {
            "until_done": {**spread(done), "largest": max(done)},
            "until_drawn": {**spread(drawn), "largest": max(drawn)},
        }
        ours = statistics.median(done)
        rows.append(Row(what, scene.title, ours, median, "ms", median, "ms", _BAR, details))
    return rows


def main(
    quick: Quick = False,
    tries: Annotated[int, typer.Option(min=1, help="Of everything.")] = 20,
    json: Json = None,
) -> None:
    """Measure how soon the viewer answers, until done (first column) and until drawn (second)."""
    tries = 1 if quick else tries
    rows = []
    for scene in _SCENES[:1] if quick else _SCENES:
        typer.echo(f"measuring: {scene.title}", err=True)
        with tempfile.TemporaryDirectory() as directory:
            rows += _rows(scene, tries, Path(directory))
    settings = {"tries": tries, "width": _WIDTH, "height": _HEIGHT, "scale": _SCALE}
    finish(sorted(rows, key=lambda row: row.measure), "until drawn", quick, json, settings)


if __name__ == "__main__":
    typer.run(main)
