"""The benchmark of many tasks runs and reports its measurements; the figures are not tested."""

import json
from pathlib import Path

import pytest

from tests.programs import run_benchmark

# It takes seconds, and shares its report and options with the one in test_suite_speed.py.
pytestmark = pytest.mark.slow


def test_a_quick_run_compares_one_batch_with_a_batch_for_each_task(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("many.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert "quick: the figures mean nothing" in done.stdout
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    limits = [row["bar"] and row["bar"]["limit"] for row in rows]
    assert limits == [4.5, 750.0, None, 8.0, 0.95]
    assert all(row["value"] > 0 for row in rows)
