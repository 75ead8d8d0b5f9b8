"""The benchmark of rows runs and reports its measurements; the figures are not tested."""

import json
from pathlib import Path

import pytest

from tests.programs import run_benchmark

# It takes seconds, and shares its report and options with the one in test_suite_speed.py.
pytestmark = pytest.mark.slow

_TASKS = ["walker:walk", "manipulator:bring_ball", "humanoid:walk", "cartpole:swingup"]


def test_a_quick_run_compares_rows_with_a_vectorised_batch_and_with_processes(
    tmp_path: Path,
) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("rows.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert "quick: the figures mean nothing" in done.stdout
    document = json.loads(file.read_text(encoding="utf-8"))
    assert document["settings"]["threads"] == 2
    assert document["settings"]["processes"] == 16
    rows = document["rows"]
    assert [row["measure"] for row in rows] == [
        *["rows / vectorised"] * 4,
        *["rows / AsyncVectorEnv"] * 4,
    ]
    assert [row["subject"].partition(",")[0] for row in rows] == _TASKS * 2
    assert [row["bar"]["limit"] for row in rows] == [1.6, 2.1, 2.0, 5.5, *[0.6] * 4]
    assert all(row["bar"]["is_maximum"] and row["value"] > 0 for row in rows)
