"""The page of a run: its charts, names, facts and film; see also tests/browser."""

import errno
import html
import html.parser
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import policies, suite
from limberjack.episodes import Episode
from limberjack.see import report
from limberjack.see.report.labels import Labels
from limberjack.see.report.result import as_result
from tests.rollouts import run_episode

_RUN = {
    "domain": "humanoid",
    "task": "walk",
    "policy": "random",
    "time_limit": 0.5,
    "control_timestep": 0.025,
    "episodes_asked_for": 1,
}


_COMMAND = "limberjack run humanoid walk --out 'a <folder>'"


def _traced(domain: str, task: str, seconds: float) -> tuple[Episode, report.Trace]:
    """An episode of random actions, and what was traced of it."""
    env = suite.load(domain, task, {"random": 3, "time_limit": seconds})
    trace = report.Trace(env)
    return run_episode(env, policies.random, 3, trace.add), trace


def _page(path: Path, **changes: Any) -> str:
    """The page of a short run, with its facts changed."""
    episode, trace = _traced("humanoid", "walk", 0.5)
    result = as_result(_RUN | changes, [episode], "abc")
    report.write_page(path, result, [episode], trace, None, "no <GL>", _COMMAND)
    return path.read_text(encoding="utf-8")


def test_tracing_changes_nothing() -> None:
    env = suite.load("manipulator", "insert_peg", {"random": 3, "time_limit": 0.5})
    alone = run_episode(env, policies.random, 3)
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


def test_names_with_markup_are_text_on_the_page(tmp_path: Path) -> None:
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
    def fill_the_disk(path: Path, content: bytes) -> None:
        path.touch()
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    for name in ("report.html", "video.mp4"):
        (tmp_path / name).write_text("of an earlier run")
    (tmp_path / "result.json").write_text(json.dumps(_RUN))
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.1})
    monkeypatch.setattr("limberjack.see.report.recorder.Film", _no_film)
    recorder = report.Recorder(tmp_path, _RUN)
    recorder.begin(env)
    episode = run_episode(env, policies.zero, 3, recorder.add_step)
    with monkeypatch.context() as full:
        full.setattr("limberjack.see.report.recorder.write_result", lambda *arguments: None)
        full.setattr(Path, "write_bytes", fill_the_disk)
        with pytest.raises(OSError, match=r"No space left.*report\."):
            recorder.write(_RUN, [episode], "abc")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result.json", "return.png"]


def _no_film(*arguments: object) -> None:
    raise ImportError("needs the extra 'video'")


def test_a_return_that_is_not_finite_is_named(tmp_path: Path) -> None:
    _, trace = _traced("humanoid", "walk", 0.5)
    broken = Episode(3, None, np.array([np.nan]))
    path = tmp_path / "report.html"
    report.write_page(path, as_result(_RUN, [broken], "abc"), [broken], trace, None)
    assert "not a number" in path.read_text()
    both = [broken, Episode(4, None, np.array([0.5, 1.0]))]
    report.write_page(path, as_result(_RUN, both, "abc"), both, trace, None)
    assert "Mean reward</dt><dd>0.7500" in path.read_text()


def test_the_page_of_a_long_episode_is_small(tmp_path: Path) -> None:
    env = suite.load("stacker", "stack_4", {"random": 0})  # 1,000 steps of 63 numbers
    trace = report.Trace(env)
    episode = run_episode(env, policies.random, 0, trace.add)
    path = tmp_path / "report.html"
    report.write_page(path, as_result(_RUN, [episode], "abc"), [episode], trace, None)
    assert episode.length == 1000
    assert path.stat().st_size < 600_000


def test_the_legends_name_joints_sensors_and_actuators_with_their_units(tmp_path: Path) -> None:
    text = _page(tmp_path / "report.html")
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", text)
    assert "joint_angles, 21 numbers, rad" in captions
    assert "head_height, one number, m" in captions
    assert "velocity, 27 numbers" in captions  # of two units
    assert "action, in brackets the force or torque of 1, 21 numbers" in captions
    names = re.findall(r"<li [^>]*>(.*?) <output>", text)
    expected = {"left_knee", "root x [m/s]", "left_knee [rad/s]", "left_hand z"}
    assert expected | {"torso_subtreelinvel x", "right_knee [80 N·m]"} <= set(names)


def test_a_page_without_labels_numbers_its_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("limberjack.see.report.trace.labels_of", lambda environment: Labels({}, ()))
    text = _page(tmp_path / "report.html")
    assert "torso_vertical, 3 numbers<" in text
    names = re.findall(r"<li [^>]*>(.*?) <output>", text)
    assert names.count("2") == 6  # of the observations with more than two numbers, and the action


def test_the_page_says_which_observations_are_too_large_for_a_chart(tmp_path: Path) -> None:
    episode, trace = _traced("cartpole", "swingup", 0.1)
    trace.too_large["<eye>"] = 21168
    path = tmp_path / "report.html"
    report.write_page(path, as_result(_RUN, [episode], "abc"), [episode], trace, None)
    assert "&lt;eye&gt;, 21,168 numbers, is too large for a chart" in path.read_text("utf-8")


def test_the_page_shows_the_command_as_typed_and_explains_the_fingerprint(tmp_path: Path) -> None:
    text = _page(tmp_path / "report.html")
    assert f"<dt>Command</dt><dd><code>{html.escape(_COMMAND)}</code></dd>" in text
    assert "<code>abc</code>" in text
    assert "SHA-256 of all names and numbers of the compiled model" in text


def test_the_page_of_several_episodes_has_curves_and_returns_of_all(tmp_path: Path) -> None:
    first, trace = _traced("humanoid", "walk", 0.5)
    episodes = [first, Episode(4, None, np.ones(30)), Episode(5, None, np.ones(7))]
    path = tmp_path / "report.html"
    result = as_result(_RUN | {"episodes_asked_for": 3}, episodes, "abc")
    report.write_page(path, result, episodes, trace, None)
    text = path.read_text(encoding="utf-8")
    part = text[text.index("<h2>All episodes") : text.index("<h2>Episodes</h2>")]
    returns, rewards, ordered = part.split("<figure")[1:]
    for chart in (returns, rewards):
        assert f"seed 3: {first.total:.3f}" in chart
        assert "seed 4: 30.000" in chart
        assert "seed 5: 7.000" in chart
    # The longest has 30 steps; that of 7 ends earlier. The last line is drawn first.
    ends = re.findall(r'points="[^"]* ([\d.]+),([\d.]+)"', returns)
    assert [float(x) for x, _ in ends] == pytest.approx(
        [1000 * 7 / 30, 1000, 1000 * 20 / 30], abs=0.1
    )
    assert f"return from {first.total:.3g} to 30" in ordered
    assert "All episodes" not in _page(tmp_path / "report.html")
