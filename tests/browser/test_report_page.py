"""report.html in a real browser, opened from disk: it plays, is right, and loads nothing else."""

import json
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.testing

from limberjack.cli import app

from .chromium import Chromium, Page

pytestmark = pytest.mark.browser

_SECONDS = 2.0
_RUN = ["run", "manipulator", "bring_ball", "--policy", "random", "--seeds", "4:7"]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of a run."""
    directory = tmp_path_factory.mktemp("run") / "a directory, with a blank"
    arguments = [*_RUN, "--time-limit", str(_SECONDS), "--out", str(directory)]
    _typed(arguments)
    return directory


@pytest.fixture(scope="module")
def scores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of an evaluation."""
    directory = tmp_path_factory.mktemp("scores")
    arguments = ["evaluate", "manipulator", "bring_ball", "--episodes", "8"]
    _typed([*arguments, "--time-limit", "0.2", "--policy", "random", "--out", str(directory)])
    return directory


def _typed(arguments: list[str]) -> None:
    """Run a command as if it had been typed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["limberjack", *arguments])
        done = typer.testing.CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    with Chromium(tmp_path_factory.mktemp("chromium")) as browser:
        yield browser


@pytest.fixture(scope="module")
def page(browser: Chromium, out: Path) -> Page:
    return browser.open((out / "report.html").as_uri())


def _texts(page: Page, selector: str) -> list[str]:
    """The text of the page's elements."""
    return page.evaluate(
        f"[...document.querySelectorAll({selector!r})].map(e => e.innerText.trim())"
    )


def _result(out: Path) -> dict[str, Any]:
    return json.loads((out / "result.json").read_text())


def test_the_page_loads_itself_alone_and_complains_of_nothing(page: Page, out: Path) -> None:
    assert page.requests == [(out / "report.html").as_uri()]
    assert page.errors == []


@pytest.mark.usefixtures("pictures")
def test_the_video_plays(page: Page) -> None:
    video = "document.querySelector('video')"
    page.wait_for(f"{video}.readyState >= 2")
    assert page.evaluate(f"{video}.error") is None
    assert page.evaluate(f"[{video}.videoWidth, {video}.videoHeight]") == [640, 480]
    assert page.evaluate(f"{video}.duration") == pytest.approx(_SECONDS, abs=0.05)
    assert page.evaluate(f"{video}.currentTime") == 0
    page.evaluate(f"{video}.play()")
    page.wait_for(f"{video}.currentTime > 0.3")
    # The charts follow it.
    assert page.evaluate("document.querySelector('.cursor').style.visibility") == "visible"
    assert page.evaluate("parseFloat(document.querySelector('.cursor').style.left)") > 0
    page.evaluate(f"{video}.pause()")
    assert page.errors == []


def test_the_page_shows_the_figures_of_the_result(page: Page, out: Path) -> None:
    result = _result(out)
    rows = [row.split() for row in _texts(page, "tbody tr")]
    assert rows == [
        [str(e["seed"]), e["start"], f"{e['return']:.3f}", str(e["length"])]
        for e in result["episodes"]
    ]
    mean = sum(e["return"] for e in result["episodes"]) / 3
    assert f"{mean:.3f}" in _texts(page, ".figures dd")
    assert _texts(page, "h1") == ["manipulator bring_ball"]
    facts = dict(zip(_texts(page, ".facts dt"), _texts(page, ".facts dd"), strict=True))
    assert facts.items() >= result["versions"].items()
    assert facts["Model"].startswith(f"{result['fingerprint']}\n")
    typed = ["limberjack", *_RUN, "--time-limit", str(_SECONDS), "--out", str(out)]
    assert facts["Command"] == shlex.join(typed)
    assert page.evaluate("JSON.parse(document.querySelector('#result').text)") == result


def test_a_click_into_a_chart_chooses_the_moment(page: Page) -> None:
    box = page.evaluate(
        "(() => { const area = document.querySelector('.area');"
        " area.scrollIntoView({block: 'center', behavior: 'instant'});"
        " const box = area.getBoundingClientRect();"
        " return [box.x, box.y, box.width, box.height]; })()"
    )
    page.click(box[0] + 0.25 * box[2], box[1] + 0.5 * box[3])
    page.wait_for("parseFloat(document.querySelector('.cursor').style.left) > 24")
    lefts = page.evaluate(
        "[...document.querySelectorAll('[data-axis=seconds] .cursor')]"
        ".map(c => parseFloat(c.style.left))"
    )
    assert lefts == pytest.approx([25.0] * len(lefts), abs=1.0)
    others = "document.querySelector('[data-axis=percent] .cursor').style.left"
    assert page.evaluate(others) == ""  # its axis is not time
    shown = _texts(page, ".legend output")
    assert len(shown) > 1
    assert all(0.0 <= float(value) <= 1.0 for value in shown[:2])
    if page.evaluate("Boolean(document.querySelector('video'))"):
        moment = page.evaluate("document.querySelector('video').currentTime")
        assert moment == pytest.approx(0.25 * _SECONDS, abs=0.05)


def test_a_name_below_a_chart_shows_its_line_alone(page: Page) -> None:
    chart = "document.querySelectorAll('.chart')[1]"
    opacities = (
        f"[...{chart}.querySelectorAll('polyline')].map(line => getComputedStyle(line).opacity)"
    )
    for begin, end in (("pointerenter", "pointerleave"), ("focus", "blur")):
        name = f"{chart}.querySelector('.legend').children[2]"
        page.evaluate(f"{name}.dispatchEvent(new Event('{begin}'))")
        # The first name's line is drawn last.
        *faint, shown, second, first = page.evaluate(opacities)
        assert shown == "1"
        assert {*faint, second, first} == {"0.12"}
        page.evaluate(f"{name}.dispatchEvent(new Event('{end}'))")
        assert set(page.evaluate(opacities)) == {"0.8"}


@pytest.mark.parametrize("width", [1280, 360])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_its_window(page: Page, width: int, scheme: str, tmp_path: Path) -> None:
    page.resize(width, 800)
    page.prefer(prefers_color_scheme=scheme)
    page.screenshot(tmp_path / "page.png")
    assert page.evaluate("document.documentElement.scrollWidth") == width
    colours = page.evaluate(
        "(style => [style.color, style.backgroundColor])(getComputedStyle(document.body))"
    )
    brightness = [sum(map(int, c[4:-1].split(","))) for c in colours]
    assert (brightness[0] < brightness[1]) == (scheme == "light")


# Last: a page of its own hides the other one, which then draws no more.
def test_the_page_of_an_evaluation_is_right_and_loads_itself_alone(
    browser: Chromium, scores: Path
) -> None:
    address = (scores / "report.html").as_uri()
    page = browser.open(address)
    assert page.requests == [address]
    assert page.errors == []
    result = _result(scores)
    assert _texts(page, "h1") == ["manipulator bring_ball"]
    assert f"{result['summary']['random']['mean']:.1f}" in _texts(page, ".figures dd")
    assert page.evaluate("document.querySelectorAll('tbody tr').length") >= 8 + 2
    for width in (1280, 360):
        page.resize(width, 800)
        assert page.evaluate("document.documentElement.scrollWidth") == width
