"""Films and pictures in a real browser: as files, and as notebooks show them."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import limberjack
from limberjack.see.notebook import Shown
from limberjack.see.video import Writer

from .chromium import Chromium

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as browser:
        yield browser


@pytest.fixture(scope="module")
def frames() -> np.ndarray:
    """Two seconds of a moving square, at 20 frames a second."""
    frames = np.zeros((40, 48, 64, 3), np.uint8)
    for number, frame in enumerate(frames):
        frame[10:20, number : number + 10] = 255, 40, 0
    return frames


def _html(shown: object) -> str:
    assert isinstance(shown, Shown)
    return shown._repr_html_()


@pytest.mark.parametrize(("element", "name"), [("video", "film.mp4"), ("img", "film.gif")])
def test_a_file_is_shown(
    element: str, name: str, browser: Chromium, frames: np.ndarray, tmp_path: Path
) -> None:
    writer = Writer(tmp_path / name, 48, 64, 20.0)
    for frame in frames:
        writer.write(frame)
    writer.finish()
    path = tmp_path / "page.html"
    path.write_text(f'<!DOCTYPE html><meta charset="utf-8"><{element} src="{name}">')
    page = browser.open(path.as_uri())
    shown = f"document.querySelector({element!r})"
    if element == "img":
        assert page.evaluate(f"[{shown}.naturalWidth, {shown}.naturalHeight]") == [64, 48]
        return
    page.wait_for(f"{shown}.readyState >= 2")
    assert page.evaluate(f"[{shown}.videoWidth, {shown}.videoHeight]") == [64, 48]
    assert page.evaluate(f"{shown}.duration") == pytest.approx(2.0, abs=0.01)


def test_a_film_plays_by_itself_where_a_notebook_shows_it(
    browser: Chromium, frames: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "cell.html"
    path.write_text(f"<!DOCTYPE html><title>cell</title>{_html(limberjack.show(frames, fps=20))}")
    page = browser.open(path.as_uri())
    page.wait_for("document.querySelector('video').currentTime > 0.1")
    assert page.evaluate("document.querySelector('video').clientWidth") == 320  # five times as wide
    assert page.requests == [path.as_uri()]
    assert page.errors == []


def test_a_picture_is_shown_where_a_notebook_shows_it(
    browser: Chromium, frames: np.ndarray, tmp_path: Path
) -> None:
    path = tmp_path / "cell.html"
    path.write_text(f"<!DOCTYPE html><title>cell</title>{_html(limberjack.show(frames[0]))}")
    page = browser.open(path.as_uri())
    assert page.evaluate("document.querySelector('img').naturalWidth") == 64
    assert page.errors == []
