"""The published scores are computed from the files of their sources."""

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest
import read_published
import typer
from read_published import Row

from limberjack import suite
from limberjack.evaluation.published import Source


def _rows(source: str, file: str, files: Mapping[str, str]) -> list[Row]:
    return list(read_published.READERS[source](file, files.__getitem__))


def test_a_mean_is_that_of_all_runs_at_the_nearest_evaluation_with_all_of_them() -> None:
    steps = {900_000: (5, 5), 1_000_000: (10, 20), 1_100_000: (90, 90)}
    steps |= {3_800_000: (1, 1), 3_900_000: (30, 50), 4_000_000: (70,)}  # one run ended early
    lines = ["step,reward,seed", *(f"{at},{x},1" for at, xs in steps.items() for x in xs)]
    files = {"results/": "cup-catch.csv\nmw-reach.csv\n", "results/cup-catch.csv": "\n".join(lines)}
    assert _rows("tdmpc2", "results/", files) == [
        Row("ball_in_cup", "catch", 1_000_000, 2, 15.0, 7.1),
        Row("ball_in_cup", "catch", 3_900_000, 2, 40.0, 14.1),
    ]


def test_a_source_that_ends_too_early_has_no_row() -> None:
    lines = "step,reward,seed\n500000,3.0,1\n"
    assert _rows("tdmpc2-sac", "r/", {"r/": "dog-run.csv", "r/dog-run.csv": lines}) == []


def test_only_returns_of_the_suites_tasks_are_read() -> None:
    lines = [
        ",exp_name,env_name,seed,metric,env_step,value",
        "0,x,dog_run,1,avg_return,1000000.0,562.4",
        "1,x,dog_run,1,avg_success,1000000.0,0.0",
        "2,x,h1-run-v0,1,avg_return,1000000.0,8.0",
    ]
    assert _rows("simbav2", "file", {"file": "\n".join(lines)}) == [
        Row("dog", "run", 1_000_000, 1, 562.4, None)
    ]


def test_actions_of_two_control_steps_are_counted_as_control_steps() -> None:
    text = "Env: Dmc-walker-run\nTimestep\tSeed 0\tSeed 1\n500000\t\t790.0\t800.0\n"
    text += "Env: Dmc-visual-walker-run\nTimestep\tSeed 0\n500000\t\t1.0\n"
    assert _rows("mrq", "file", {"file": text}) == [Row("walker", "run", 1_000_000, 2, 795.0, 7.1)]


def test_a_table_is_found_by_its_heading() -> None:
    page = """
| | ppo_continuous_action_8M ({'tag': ['v1']}) | rpo_continuous_action ({'tag': ['v2']}) |
|:---|:---|:---|
| dm_control/humanoid_CMU-run-v0 | 0.88 ± 0.09 | 0.80 ± 0.09 |

| | others ({'tag': ['v1']}) | others ({'tag': ['v2']}) |
|:---|:---|:---|
| dm_control/walker-run-v0 | 5 ± 1 | 6 ± 1 |
"""
    found = [_rows(name, "page", {"page": page}) for name in ("cleanrl-ppo-8m", "cleanrl-rpo-8m")]
    assert found == [
        [Row("humanoid_CMU", "run", 8_000_000, 10, 0.9, 0.1)],
        [Row("humanoid_CMU", "run", 8_000_000, 10, 0.8, 0.1)],
    ]


def test_the_best_of_the_released_policies_is_kept() -> None:
    policies = [
        {"task.task_name": "fish_swim", "return_mean": mean, "return_std": 250.04}
        for mean in (100.0, 547.44, 300.0)
    ]
    assert _rows("deep-ope", "file", {"file": json.dumps(policies)}) == [
        Row("fish", "swim", None, 1, 547.4, 250.0)
    ]


def test_every_source_with_a_commit_has_a_reader() -> None:
    content = json.loads(read_published.FILE.read_text(encoding="utf-8"))
    with_commit = {name for name, facts in content["sources"].items() if facts["revision"]}
    assert with_commit == set(read_published.READERS)


def test_the_file_is_as_the_program_writes_it() -> None:
    text = read_published.FILE.read_text(encoding="utf-8")
    assert read_published.text_of(json.loads(text)) == text


def test_rows_written_by_hand_stay_and_tasks_without_a_row_are_named() -> None:
    content = json.loads(read_published.FILE.read_text(encoding="utf-8"))
    names = ("d4pg", "deep-ope")
    few = {**content, "sources": {name: content["sources"][name] for name in names}}
    policies = [{"task.task_name": "fish_swim", "return_mean": 1.0, "return_std": 0.0}]
    by_hand = [row for row in content["scores"] if row[2] == "d4pg"]
    made = read_published.computed({**few, "scores": by_hand}, lambda *_: json.dumps(policies))
    assert made["scores"] == [("fish", "swim", "deep-ope", None, 1, 1.0, 0.0), tuple(by_hand[0])]
    assert len(made["none_found"]) == len(suite.ALL_TASKS) - 2
    assert ("fish", "upright") in made["none_found"]


def test_it_reads_the_commits_of_the_table_and_notices_a_difference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clone = tmp_path / "clones" / "sheets"
    (clone / "results").mkdir(parents=True)
    (clone / "results" / "dog-run.csv").write_text("step,reward,seed\n1000000,3.0,1\n")

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(clone), "-c", "user.name=x", "-c", "user.email=x@y.z"]
        return subprocess.run(
            [*command, *arguments], check=True, capture_output=True, text=True
        ).stdout

    git("init", "--quiet")
    git("add", ".")
    git("commit", "--quiet", "--message", "Add results")
    facts = {
        "algorithm": "A",
        "address": "https://github.com/somebody/sheets",
        "revision": git("rev-parse", "HEAD").strip(),
        "file": "results/",
        "licence": "MIT",
        "action_repeat": None,
        "mean": "m",
        "spread": "s",
        "second_hand": None,
    }
    assert Source("tdmpc2", **facts).revision
    file = tmp_path / "published.json"
    content = {"sources": {"tdmpc2": facts}, "columns": [], "scores": [], "none_found": []}
    file.write_text(json.dumps(content), encoding="utf-8")
    monkeypatch.setattr(read_published, "FILE", file)
    with pytest.raises(typer.Exit):
        read_published.main(tmp_path / "clones", check=True)
    assert json.loads(file.read_text(encoding="utf-8")) == content  # nothing was written
    read_published.main(tmp_path / "clones")
    made = json.loads(file.read_text(encoding="utf-8"))
    assert made["scores"] == [["dog", "run", "tdmpc2", 1_000_000, 1, 3.0, None]]
    read_published.main(tmp_path / "clones", check=True)
