"""docs/scores.md is what benchmarks/scores.py makes of the committed results."""

import importlib.util
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.evaluation import Score, evaluate
from limberjack.evaluation.statistics import strata, summarise
from limberjack.mujoco.camera import RenderingError

_REPOSITORY = Path(__file__).parents[2]
_RESULTS = sorted((_REPOSITORY / "benchmarks" / "results" / "scores").glob("*.json"))


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The script, writing to a folder of the test's own."""
    monkeypatch.syspath_prepend(_REPOSITORY / "benchmarks")
    spec = importlib.util.spec_from_file_location("scores", _REPOSITORY / "benchmarks/scores.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "_PAGE", tmp_path / "scores.md")
    monkeypatch.setattr(module, "_IMAGES", tmp_path)
    return module


def test_the_page_is_made_of_the_committed_results(script: Any, tmp_path: Path) -> None:
    script.main([])
    made = (tmp_path / "scores.md").read_text(encoding="utf-8")
    assert (_REPOSITORY / "docs" / "scores.md").read_text(encoding="utf-8") == made


def test_the_scores_in_the_readme_are_those_of_the_committed_results() -> None:
    text = (_REPOSITORY / "README.md").read_text(encoding="utf-8")
    sentence = r"(?s)over (\d+) fresh episodes of each task it reaches\s(.*?)\s\("
    ((episodes, scores),) = re.findall(sentence, text)
    told = re.findall(r"(\d+)(?: of 1,000)? on\s(?:humanoid\s)?(\w+)", scores)
    assert len(told) == len(re.findall(r"\b\d{3}\b", scores.replace(" of 1,000", ""))) > 4
    results = {path.stem.split("-")[1]: path for path in _RESULTS if path.stem.endswith("planner")}
    for score, task in told:
        summary = json.loads(results[task].read_text(encoding="utf-8"))["summary"]["planner"]
        assert summary["episodes"] == int(episodes)
        assert int(score) == round(summary["mean"]), task


def test_a_folder_is_taken_over(script: Any, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(script, "_RESULTS", tmp_path / "results")
    evaluation = evaluate(
        "stacker", "stack_2", "evaluated:Arm", range(4), out=tmp_path / "out", time_limit=0.05
    )
    script.main([str(tmp_path / "out")])
    assert [path.name for path in (tmp_path / "results").iterdir()] == [
        "stacker-stack_2-evaluated-Arm.json"
    ]
    mean, (low, high) = evaluation.summary().mean, evaluation.summary().interval or (0, 0)
    row = f"| stack_2 | evaluated:Arm | 0:4 | **{mean:.1f}** | {low:.1f} to {high:.1f} |"
    page = (tmp_path / "scores.md").read_text(encoding="utf-8")
    assert row in page
    assert "| stack_2 | zero | 0:4 |" in page


def test_what_the_planner_does_not_solve_is_drawn(
    script: Any, tmp_path: Path, monkeypatch: Any
) -> None:
    try:
        suite.load("manipulator", "bring_peg").physics.render(height=8, width=8)
    except RenderingError as error:
        pytest.skip(f"no OpenGL here: {error}")
    monkeypatch.setattr(script, "_RESULTS", tmp_path)
    path = _REPOSITORY / "benchmarks/results/scores/manipulator-bring_peg-planner.json"
    result = json.loads(path.read_text(encoding="utf-8"))
    result["episodes"] = [e for e in result["episodes"] if not e["success"]][:2] + [
        e for e in result["episodes"] if e["success"]
    ][:3]
    (tmp_path / "result.json").write_text(json.dumps(result))
    script.main([str(tmp_path)])
    picture = (tmp_path / "unsolved-bring_peg.png").read_bytes()
    width, height = (int.from_bytes(picture[at : at + 4]) for at in (16, 20))
    assert (height, width) == (150, 2 * 200)  # the two side by side
    page = (tmp_path / "scores.md").read_text(encoding="utf-8")
    assert "bring_peg, 2 of 100:\n\n![Starts of bring_peg that" in page
    assert "](images/unsolved-bring_peg.png)" in page


@pytest.mark.parametrize("path", _RESULTS, ids=lambda path: path.stem)
def test_the_figures_of_a_committed_result_follow_from_its_episodes(path: Path) -> None:
    result = json.loads(path.read_text(encoding="utf-8"))
    scores = [
        Score(e["seed"], e["return"], e["length"], e["final_reward"], start=e.get("start"))
        for e in result["episodes"]
    ]
    told = result["summary"][result["policy"]]
    by_start = told.pop("strata")
    assert told == json.loads(json.dumps(summarise(scores).as_json()))
    expected = {start: part.as_json() for start, part in strata(scores).items()}
    assert by_start == json.loads(json.dumps(expected))
    assert len(scores) == result["episodes_asked_for"]
    assert [score.success for score in scores] == [e["success"] for e in result["episodes"]]
    for policy, floor in result["floors"].items():
        assert result["summary"][policy]["mean"] == np.mean(floor["returns"])
        assert len(floor["returns"]) == len(floor["final_rewards"]) == len(scores)
