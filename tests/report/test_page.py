"""report.html: what is traced, how it is drawn, and what the page says; see also tests/browser."""

import errno
import html.parser
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import policies, report, rollout, suite
from limberjack.report.result import as_result

_RUN = {
    "domain": "humanoid",
    "task": "walk",
    "policy": "random",
    "time_limit": 0.5,
    "control_timestep": 0.025,
    "episodes_asked_for": 1,
}


def _traced(domain: str, task: str, seconds: float) -> tuple[rollout.Episode, report.Trace]:
    """An episode of random actions, and what was traced of it."""
    env = suite.load(domain, task, {"random": 3, "time_limit": seconds})
    trace = report.Trace(env)
    return rollout.run_episode(env, policies.random, 3, trace.add), trace


def _page(path: Path, **changes: Any) -> str:
    """The page of a short run, with its facts changed."""
    episode, trace = _traced("humanoid", "walk", 0.5)
    result = as_result(_RUN | changes, [episode], "abc")
    report.write_page(path, result, trace, None, "no <GL>")
    return path.read_text(encoding="utf-8")


def test_tracing_changes_nothing() -> None:
    env = suite.load("manipulator", "insert_peg", {"random": 3, "time_limit": 0.5})
    alone = rollout.run_episode(env, policies.random, 3)
    traced, _ = _traced("manipulator", "insert_peg", 0.5)
    np.testing.assert_array_equal(traced.rewards, alone.rewards)


class _Outside(html.parser.HTMLParser):
    """Collects everything by which a page could reach outside itself."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [
            value or "" for name, value in attrs
            if name in ("href", "src", "srcset", "action", "data", "poster", "xlink:href")
        ]  # fmt: skip
        if tag not in ("meta", "link"):  # which have no end
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if self.open[-1:] == [tag]:
            self.open.pop()


def test_the_page_is_whole_and_names_no_address(tmp_path: Path) -> None:
    text = _page(tmp_path / "report.html")
    parser = _Outside()
    parser.feed(text)
    assert [address for address in parser.addresses if not address.startswith("data:")] == []
    assert parser.open == []
    assert "://" not in text
    assert "url(" not in text
    assert "@import" not in text
    assert "default-src 'none'" in text
    assert "$" not in text
    assert list(tmp_path.iterdir()) == [tmp_path / "report.html"]


def test_what_comes_from_outside_is_text_on_the_page(tmp_path: Path) -> None:
    hostile = "m:</script><script>alert(1)</script><b>&"
    text = _page(tmp_path / "report.html", policy=hostile)
    assert "<script>alert" not in text
    assert "<b>" not in text
    assert "no &lt;GL&gt;" in text
    data = re.search(r'<script type="application/json" id="result">(.*?)</script>', text)
    assert data is not None
    assert json.loads(data[1])["policy"] == hostile


def test_the_page_of_a_run_that_was_cut_short_says_so(tmp_path: Path) -> None:
    text = _page(tmp_path / "report.html", episodes_asked_for=3)
    assert "cut short after 1 of 3 episodes" in text


def test_a_page_that_cannot_be_written_leaves_nothing_of_itself_or_of_an_earlier_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fill_the_disk(path: Path, text: str, encoding: str) -> None:
        path.touch()
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    for name in ("report.html", "video.mp4"):
        (tmp_path / name).write_text("of an earlier run")
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.1})
    monkeypatch.setattr("limberjack.report.recorder.Film", _no_film)
    recorder = report.Recorder(tmp_path, _RUN)
    recorder.begin(env)
    episode = rollout.run_episode(env, policies.zero, 3, recorder.add_step)
    with monkeypatch.context() as full:
        full.setattr("limberjack.report.recorder.write_result", lambda *arguments: None)
        full.setattr(Path, "write_text", fill_the_disk)
        with pytest.raises(OSError, match=r"No space left.*report\."):
            recorder.write(_RUN, [episode], "abc")
    assert [path.name for path in tmp_path.iterdir()] == ["return.png"]


def _no_film(*arguments: object) -> None:
    raise ImportError("needs the extra 'video'")


def test_a_return_that_is_not_finite_is_named(tmp_path: Path) -> None:
    _, trace = _traced("humanoid", "walk", 0.5)
    broken = rollout.Episode(3, None, np.array([np.nan]))
    path = tmp_path / "report.html"
    report.write_page(path, as_result(_RUN, [broken], "abc"), trace, None, "")
    assert "not a number" in path.read_text()


def test_the_page_of_a_long_episode_is_small(tmp_path: Path) -> None:
    env = suite.load("stacker", "stack_4", {"random": 0})  # 1,000 steps of 63 numbers
    trace = report.Trace(env)
    episode = rollout.run_episode(env, policies.random, 0, trace.add)
    path = tmp_path / "report.html"
    report.write_page(path, as_result(_RUN, [episode], "abc"), trace, None, "")
    assert episode.length == 1000
    assert path.stat().st_size < 450_000
