"""`limberjack view` in a real browser: its pictures, and its keys' effects on the environment."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from .chromium import Page
from .viewing import LIMIT, viewed_by, wait

pytestmark = pytest.mark.browser

pytest.importorskip(
    "limberjack.viewer.studio", reason="MuJoCo Studio does not load here", exc_type=ImportError
)
Image = pytest.importorskip("PIL.Image", reason="needs Pillow, which comes with the extra 'video'")

_STILL = 1.0  # seconds; forty control steps, were it not paused
_WIDTH, _HEIGHT = 480, 360  # pixels; few, as they are drawn without a graphics card
_PANEL_WIDTH = 170  # pixels of the left that the panel may cover
# The DevTools protocol's code and number of each key.
_KEYS = {" ": ("Space", 32), "Backspace": ("Backspace", 8), "ArrowRight": ("ArrowRight", 39)}

# Writes a line per start and per step, with what was observed.
_SPY = """
import zlib
import numpy as np

class Spy:
    def __init__(self):
        self.file = open("spied", "w", buffering=1)

    def reset(self):
        print("reset", file=self.file)

    def act(self, observation):
        seen = b"".join(np.asarray(part).tobytes() for part in observation.values())
        print("act", zlib.crc32(seen), file=self.file)
        return np.zeros(21)
"""


class _Viewed:
    """A page of the viewer, and what its environment's policy has seen."""

    def __init__(self, page: Page, address: str, spied: Path) -> None:
        self.page = page
        self.address = address
        self._spied = spied

    def lines(self, what: str) -> list[str]:
        return [line for line in self._spied.read_text().splitlines() if line.startswith(what)]

    def steps(self) -> int:
        return len(self.lines("act"))

    def press(self, key: str, until: Callable[[], bool]) -> None:
        """Holds a key down until it has had its effect: frames may take long here."""
        code, number = _KEYS[key]
        about = {"code": code, "key": key, "windowsVirtualKeyCode": number}
        self.page.call("Input.dispatchKeyEvent", type="rawKeyDown", **about)
        wait(until)
        self.page.call("Input.dispatchKeyEvent", type="keyUp", **about)

    def is_still(self) -> bool:
        """Whether no step is taken for a while."""
        before = self.steps()
        time.sleep(_STILL)
        return self.steps() == before

    def picture(self, path: Path) -> np.ndarray:
        """The picture beside the panel, (height, width, 3), also written to a file."""
        self.page.screenshot(path, whole=False)
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"), int)[:, _PANEL_WIDTH:]


@pytest.fixture(scope="module")
def viewed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[_Viewed]:
    directory = tmp_path_factory.mktemp("view")
    (directory / "spies.py").write_text(_SPY)
    arguments = ["view", "humanoid", "stand", "--policy", "spies:Spy", "--time-limit", "1000"]
    with viewed_by(["-m", "limberjack", *arguments], directory, _WIDTH, _HEIGHT) as (page, address):
        yield _Viewed(page, address, directory / "spied")


def _brown(picture: np.ndarray) -> np.ndarray:
    """A mask of the humanoid's colour; the floor and the sky are blue."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    return (red > green + 20) & (green > blue + 20)


@pytest.fixture(scope="module")
def seen(viewed: _Viewed, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """The first picture with the humanoid."""
    path = tmp_path_factory.mktemp("viewer") / "humanoid.png"
    end = time.monotonic() + LIMIT
    while _brown(picture := viewed.picture(path)).sum() < 300:
        assert time.monotonic() < end, f"no humanoid is seen after {LIMIT:g} seconds: {path}"
    return picture


def test_the_humanoid_is_seen(seen: np.ndarray) -> None:
    assert len(np.unique(seen.reshape(-1, 3), axis=0)) > 1000  # colours: light, floor, shadows
    blue = seen[..., 2] > seen[..., 0] + 20
    assert blue.mean() > 0.3  # floor and sky


def test_space_pauses_and_the_arrow_takes_a_step(viewed: _Viewed, seen: np.ndarray) -> None:
    assert viewed.steps() > 0
    assert not viewed.is_still()
    viewed.press(" ", until=viewed.is_still)
    steps = viewed.steps()
    viewed.press("ArrowRight", until=lambda: viewed.steps() > steps)
    assert viewed.is_still()
    assert viewed.steps() == steps + 1
    viewed.press(" ", until=lambda: viewed.steps() > steps + 10)


def test_backspace_begins_the_next_episode(viewed: _Viewed, seen: np.ndarray) -> None:
    episodes = len(viewed.lines("reset"))
    viewed.press("Backspace", until=lambda: len(viewed.lines("reset")) > episodes)
    assert len(viewed.lines("reset")) == episodes + 1
    wait(lambda: viewed.lines("")[-1].startswith("act"))
    text = "\n".join(viewed.lines(""))
    starts = [episode.split("\n")[1] for episode in text.split("reset")[1:]]
    assert len(set(starts)) == len(starts)  # each has a seed of its own


def test_the_page_needs_nothing_from_elsewhere_and_does_not_complain(
    viewed: _Viewed, seen: np.ndarray
) -> None:
    own = viewed.address.partition("?")[0]
    assert all(request.startswith(own) for request in viewed.page.requests)
    assert viewed.page.errors == []
