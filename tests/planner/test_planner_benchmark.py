"""The planner and reach benchmarks run and report their measurements; figures are not tested."""

import json
from pathlib import Path

from limberjack.utils.cores import usable_cores
from tests.programs import run_benchmark

from .planned import PLANNED


def test_a_plan_is_timed_for_each_number_of_threads(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("planner.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    timed = [row["subject"] for row in rows if row["measure"] == "plan / two control steps"]
    assert "humanoid:stand, 1 thread" in timed
    assert any(subject.startswith(f"humanoid:stand, {usable_cores()} ") for subject in timed)
    assert all(row["value"] > 0 for row in rows)
    assert "quick: the figures mean nothing" in done.stdout


def test_searches_for_paths_are_timed(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("path_searches.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    median, most, worst = (row["value"] for row in rows)
    assert 0 < median <= most <= worst
    assert "quick: the figures mean nothing" in done.stdout


def test_what_is_within_reach_is_told_for_each_task_of_the_arm(tmp_path: Path) -> None:
    file = tmp_path / "reach.json"
    done = run_benchmark("reach.py", "--episodes", "1", "--json", str(file))
    assert done.returncode == 0, done.stderr
    results = json.loads(file.read_text(encoding="utf-8"))
    assert [result["task"] for result in results] == [
        task for domain, task in PLANNED if domain != "humanoid"
    ]
    for result in results:
        assert result["taken"] + result["raked"] <= 1
        assert 0 <= result["brought"] <= 1
        assert 1000 * (result["taken"] + result["brought"] - 1) <= result["cap"] <= 1000
