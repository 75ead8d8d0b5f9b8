"""The page of an evaluation: its summaries, charts, episodes and facts."""

import html
import re
from pathlib import Path
from typing import Any

import pytest

from limberjack import evaluation
from limberjack.see import report

_COMMAND = "limberjack evaluate manipulator bring_ball --policy random --out 'a <folder>'"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files of an evaluation."""
    directory = tmp_path_factory.mktemp("scores")
    evaluation.evaluate(
        "manipulator",
        "bring_ball",
        "random",
        range(6),
        out=directory,
        time_limit=0.2,
        command=_COMMAND,
    )
    return directory


@pytest.fixture(scope="module")
def text(out: Path) -> str:
    return (out / "report.html").read_text(encoding="utf-8")


def _rows(text: str, heading: str) -> list[list[str]]:
    """The cells of the first table below a heading."""
    table = text[text.index(f"<h2>{heading}</h2>") :]
    table = table[: table.index("</table>")]
    lines = re.findall(r"<tr>(.*?)</tr>", table)[1:]
    return [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", line) for line in lines]


def test_the_page_has_every_policy_start_and_episode(out: Path, text: str) -> None:
    again = evaluation.evaluate(
        "manipulator", "bring_ball", "random", range(6), out=out, time_limit=0.2
    )
    expected = []
    for policy in ("random", "zero"):
        for start, summary in {"all": again.summary(policy), **again.strata(policy)}.items():
            expected.append(
                [
                    policy if start == "all" else "",
                    start,
                    str(summary.episodes),
                    f"{summary.mean:.1f}",
                ]
            )
    assert [row[:4] for row in _rows(text, "Policies on the same seeds")] == expected
    assert _rows(text, "Episodes of random") == [
        [
            str(score.seed),
            str(score.start),
            f"{score.total:.3f}",
            str(score.length),
            f"{score.final_reward:.3f}",
            "no",
        ]
        for score in again.scores["random"]
    ]


def test_returns_are_drawn_by_policy_and_by_start(text: str) -> None:
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", text)
    assert [caption.split(",")[0] for caption in captions] == [
        "Returns by policy",
        "Returns of random by start",
    ]
    names = re.findall(r"<li [^>]*>(.*?) <output>", text)
    assert names[:2] == ["random (6)", "zero (6)"]


def test_the_page_explains_its_words_and_shows_the_command(text: str) -> None:
    assert f"<code>{html.escape(_COMMAND)}</code>" in text
    assert "<dt>Seeds</dt><dd>0:6</dd>" in text
    assert "SHA-256 of all names and numbers of the compiled model" in text
    assert "Success: a mean reward of at least 0.9 over the last 100 steps." in text
    assert "by percentile bootstrap with 10,000 resamples." in text
    assert "://" not in text


def test_an_evaluation_of_one_episode_without_starts_has_a_page(tmp_path: Path) -> None:
    scores = evaluation.evaluate("humanoid", "stand", "zero", [3], out=tmp_path, time_limit=0.1)
    assert tmp_path / "report.html" in scores.files
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Command" not in text
    assert "interval of the mean</dt>" not in text  # one episode has none
    assert len(_rows(text, "Episodes of zero")) == 1


def test_diverged_episodes_and_other_versions_are_shown(tmp_path: Path) -> None:
    result = _result()
    result["episodes"][0] |= {"diverged": True}
    result["summary"]["mine"] |= {"diverged": 1}
    result["versions_of_episodes"] = [{"mujoco": "4.0.0"}, {"mujoco": "4.0.1"}]
    path = tmp_path / "report.html"
    report.write_evaluation_page(path, result)
    text = path.read_text(encoding="utf-8")
    assert _rows(text, "Episodes of mine") == [["0", "1.500", "2", "0.750", "diverged"]]
    assert "<dt>Diverged</dt><dd>1</dd>" in text
    assert "<dt>Played with</dt><dd>mujoco 4.0.0; mujoco 4.0.1</dd>" in text


def _of(episodes: int) -> Any:
    """A result of many episodes, with two kinds of starts, whose returns are their numbers."""
    result = _result()
    entry = {"start": "in a corner", "length": 1000, "final_reward": 1 / 3, "success": True}
    result["episodes"] = [
        {**entry, "seed": 10**9 + seed, "return": seed + 1 / 3} for seed in range(episodes)
    ]
    result["episodes"][-1]["start"] = "hanging"
    returns = [entry["return"] for entry in result["episodes"]]
    floor = {"returns": returns, "final_rewards": [1 / 3] * episodes}
    return {
        **result,
        "floors": {"zero": floor, "random": floor},
        "seeds": [entry["seed"] for entry in result["episodes"]],
    }


def test_a_page_of_many_episodes_has_a_sample_and_quantiles_and_stays_small(
    tmp_path: Path,
) -> None:
    path = tmp_path / "report.html"
    sizes = []
    for episodes in (10_000, 10_001, 30_000):
        report.write_evaluation_page(path, _of(episodes))
        sizes.append(path.stat().st_size)
        text = path.read_text(encoding="utf-8")
        if episodes == 10_000:
            assert len(_rows(text, "Episodes of mine")) == 10_000
            assert "Quantiles" not in text
            continue
        rows = _rows(text, f"Episodes of mine: 1,000 of {episodes:,}")
        assert (rows[0][0], rows[-1][0]) == ("1000000000", str(10**9 + episodes - 1))
        assert len({row[0] for row in rows}) == 1000
        assert f"{episodes:,} seeds from 1000000000 to {10**9 + episodes - 1}, as in" in text
    assert max(sizes) < 5e6
    assert max(sizes[1:]) < 1e6
    rows = {row[0]: row[1:] for row in _rows(text, "Quantiles of returns")}
    assert list(rows) == ["mine", "zero", "random", "hanging", "in a corner"]
    assert rows["mine"][:2] == ["0.333", "300.323"]
    assert rows["mine"][-1] == rows["hanging"][0] == "29999.333"


def _result() -> Any:
    """A result of one episode, as `Evaluation.as_json` has it."""
    summary = {
        "episodes": 1,
        "mean": 1.5,
        "interval": None,
        "median": 1.5,
        "diverged": 0,
        "success_rate": 0.0,
        "strata": {},
    }
    return {
        "domain": "swing",
        "task": "up",
        "policy": "mine",
        "time_limit": None,
        "control_timestep": 0.02,
        "versions": {"mujoco": "4.0.1"},
        "fingerprint": "abc",
        "seeds": [0],
        "success": {"last_steps": 100, "mean_reward_at_least": 0.9},
        "interval": {"confidence": 0.95, "method": "percentile bootstrap", "resamples": 10_000},
        "summary": {"mine": summary, "zero": dict(summary)},
        "episodes": [
            {"seed": 0, "return": 1.5, "length": 2, "final_reward": 0.75, "success": False}
        ],
        "floors": {"zero": {"returns": [1.5], "final_rewards": [0.75]}},
    }
