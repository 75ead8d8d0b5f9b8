"""The benchmark of writing runs and reports its measurements; the figures are not tested."""

import json
from pathlib import Path

import pytest

from tests.programs import run_benchmark

# It takes seconds, and shares its report and options with the one in test_suite_speed.py.
pytestmark = pytest.mark.slow


def test_a_quick_run_measures_units_planning_and_footers(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("writing.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert "quick: the figures mean nothing" in done.stdout
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    assert [row["measure"] for row in rows] == ["a unit", "planning", "planning", "footer"]
    assert [row["bar"]["limit"] for row in rows] == [2.0, 10.0, 10.0, 5.0]
    assert all(row["value"] > 0 for row in rows)
