"""The benchmark of plans runs, and says what it measured. What the figures are is its to say."""

import json
import os
import subprocess
import sys
from pathlib import Path

import limberjack
from limberjack.utils.cores import usable_cores

_SCRIPT = Path(__file__).parents[2] / "benchmarks" / "planner.py"
_SOURCE = Path(limberjack.__file__).parents[1]
_LIMIT = 300  # seconds; more than the slowest machine needs


def test_a_plan_is_timed_for_each_number_of_threads(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    known = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([str(_SOURCE), *([known] if known else [])])
    done = subprocess.run(
        [sys.executable, str(_SCRIPT), "--quick", "--json", str(file)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        timeout=_LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    timed = [row["subject"] for row in rows if row["measure"] == "plan / two control steps"]
    assert "humanoid:stand, 1 thread" in timed
    assert any(subject.startswith(f"humanoid:stand, {usable_cores()} ") for subject in timed)
    assert all(row["value"] > 0 for row in rows)
    assert "bars met" in done.stdout
