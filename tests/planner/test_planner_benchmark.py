"""The benchmark of plans runs, and says what it measured. What the figures are is its to say."""

import json
from pathlib import Path

from programs import run_benchmark

from limberjack.utils.cores import usable_cores


def test_a_plan_is_timed_for_each_number_of_threads(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("planner.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    timed = [row["subject"] for row in rows if row["measure"] == "plan / two control steps"]
    assert "humanoid:stand, 1 thread" in timed
    assert any(subject.startswith(f"humanoid:stand, {usable_cores()} ") for subject in timed)
    assert all(row["value"] > 0 for row in rows)
    assert "bars met" in done.stdout
