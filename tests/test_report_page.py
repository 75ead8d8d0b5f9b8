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
from limberjack.report import trace as trace_module
from limberjack.report.chart import Line, line_chart, thinned
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


@pytest.mark.parametrize(("domain", "task"), suite.ALL_TASKS)
def test_a_trace_is_of_every_step(domain: str, task: str) -> None:
    episode, trace = _traced(domain, task, 0.25)
    count = episode.length + 1
    np.testing.assert_array_equal(trace.rewards[1:], episode.rewards)
    assert np.isnan(trace.rewards[0])
    env = suite.load(domain, task, {"random": 3, "time_limit": 0.25})
    np.testing.assert_array_equal(trace.seconds, np.arange(count) * env.control_timestep())
    observation = env.reset().observation
    assert list(trace.observations) == list(observation)
    for name, value in observation.items():
        assert trace.observations[name].shape == (count, np.size(value))
        np.testing.assert_array_equal(trace.observations[name][0], np.ravel(value))
    step = env.step(policies.random(env.action_spec(), 3)(observation))
    assert step.reward == trace.rewards[1]
    assert {name: series[1] for name, series in trace.terms.items()} == env.task.reward_terms(
        env.physics
    )


def test_tracing_changes_nothing() -> None:
    env = suite.load("manipulator", "insert_peg", {"random": 3, "time_limit": 0.5})
    alone = rollout.run_episode(env, policies.random, 3)
    traced, _ = _traced("manipulator", "insert_peg", 0.5)
    np.testing.assert_array_equal(traced.rewards, alone.rewards)


def test_a_long_trace_is_kept_in_part(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trace_module, "_MOST_SAMPLES", 8)
    episode, trace = _traced("humanoid", "walk", 0.5)  # 20 steps
    np.testing.assert_allclose(trace.seconds, 0.025 * np.arange(0, 21, 4))
    np.testing.assert_array_equal(trace.rewards[1:], episode.rewards[3::4])
    assert all(len(series) == 6 for series in trace.observations.values())


def test_a_task_without_terms_is_traced_by_its_reward() -> None:
    env = suite.load("humanoid", "walk", {"random": 0, "time_limit": 0.05})
    env.task.get_reward = lambda physics: 0.25  # pyright: ignore[reportAttributeAccessIssue]
    trace = report.Trace(env)
    rollout.run_episode(env, policies.zero, 0, trace.add)
    assert trace.rewards[1:].tolist() == [0.25, 0.25]
    assert trace.terms == {}


def test_a_task_that_draws_for_its_observation_draws_no_more_when_traced() -> None:
    def run(*, traced: bool) -> list[list[float]]:
        env = suite.load("stacker", "stack_2", {"random": 3, "time_limit": 0.05})
        task, observe = env.task, env.task.get_observation
        task.get_observation = lambda physics: {
            "noise": task.random.standard_normal(2),
            **observe(physics),
        }
        seen: list[list[float]] = []
        trace = report.Trace(env)

        def add(step: rollout.Step) -> None:
            seen.append(step.time_step.observation["noise"].tolist())
            if traced:
                trace.add(step)

        rollout.run_episode(env, policies.zero, 3, add)
        assert not traced or trace.observations["noise"].tolist() == seen
        return seen

    assert run(traced=True) == run(traced=False)


def test_a_directory_is_one_recorders_and_of_one_task_and_policy(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    with report.Recorder(tmp_path, _RUN) as first:
        with pytest.raises(ValueError, match="another process writes to"):
            report.Recorder(tmp_path, _RUN)
        first.write(_RUN, [], "abc")
    for name, other in (("domain", "stacker"), ("task", "run"), ("policy", "zero")):
        with pytest.raises(ValueError, match=f"holds results with {name} '{_RUN[name]}', and"):
            report.Recorder(tmp_path, _RUN | {name: other})
    report.Recorder(tmp_path, _RUN | {"time_limit": 1.0}).close()
    (tmp_path / "episodes.jsonl").touch()
    with pytest.raises(ValueError, match="holds an evaluation: choose another folder"):
        report.Recorder(tmp_path, _RUN)


def test_thinning_keeps_the_peaks_and_what_is_finite() -> None:
    values = np.zeros(10_000)
    values[1234], values[5678], values[9999] = 5.0, -7.0, np.nan
    kept = thinned(values, 100)
    assert len(kept) <= 200
    assert {1234, 5678} <= set(kept.tolist())
    assert 9999 not in kept
    assert (np.diff(kept) > 0).all()
    assert thinned(np.array([1.0, np.inf, 2.0])).tolist() == [0, 2]
    assert thinned(np.full(3, np.nan)).tolist() == []


def _points(chart: str) -> list[list[tuple[float, ...]]]:
    lines = re.findall(r'points="([^"]*)"', chart)
    return [[tuple(map(float, p.split(","))) for p in line.split()] for line in lines]


def test_a_chart_is_drawn_to_scale() -> None:
    values = np.array([np.nan, 0.0, 1.0, 0.5])
    chart = line_chart("Reward", np.arange(4) * 0.5, [Line("reward", values)], 0.0, 1.0)
    ((first, second, third),) = _points(chart)
    assert [first[0], second[0], third[0]] == pytest.approx([333.3, 666.7, 1000.0], abs=0.1)
    # The range is 0 to 1 and a margin of 5 % above and below.
    assert [first[1], second[1], third[1]] == pytest.approx([95.45, 4.55, 50.0], abs=0.01)
    assert re.findall(r'<span style="left: ([\d.]+)%">([\d.]+)', chart)[:2] == [
        ("0.00", "0"),
        ("13.33", "0.2"),
    ]
    assert 'aria-label="Reward: reward from 0 to 1"' in chart


def test_a_chart_of_a_constant_and_one_of_nothing_can_be_drawn() -> None:
    for value in (3.0, 0.0, -1e-9, 1e12, np.nan):
        chart = line_chart("x", np.arange(3.0), [Line("x", np.full(3, value))])
        assert "nan" not in chart.replace(" without values", "")
        assert "inf" not in chart


def test_few_lines_have_names_and_many_have_shades() -> None:
    seconds = np.arange(5.0)
    few = [Line(f"line {i}", seconds) for i in range(3)]
    many = [Line(f"line {i}", seconds) for i in range(30)]
    assert line_chart("few", seconds, few).count("<li class=") == 3
    chart = line_chart("many", seconds, many)
    assert "<li " not in chart
    assert len(set(re.findall(r"--hue: \d+", chart))) == 30


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
