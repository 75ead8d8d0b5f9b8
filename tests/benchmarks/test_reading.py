"""The benchmark of readers runs and reports its measurements; the figures are not tested."""

import json
from pathlib import Path

import pytest

from tests.programs import run_benchmark

# It takes seconds, and shares its report and options with the one in test_suite_speed.py.
pytestmark = pytest.mark.slow


def test_a_quick_run_compares_each_reader_with_batches(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("reading.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert "quick: the figures mean nothing" in done.stdout
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    assert len(rows) == 16
    limits = [row["bar"] and row["bar"]["limit"] for row in rows]
    assert sorted(limit for limit in limits if limit) == [0.4] * 2 + [0.5] * 8 + [0.7] * 2
    assert all(row["value"] > 0 for row in rows)
