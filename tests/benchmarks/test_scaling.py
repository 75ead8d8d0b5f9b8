"""The benchmark of workers runs and reports its measurements; the figures are not tested."""

import json
from pathlib import Path

import pytest

from tests.programs import run_benchmark

# It takes seconds, and shares its report and options with the one in test_suite_speed.py.
pytestmark = pytest.mark.slow


def test_a_quick_run_compares_workers_with_one_process(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("scaling.py", "--quick", "--only", "random", "--json", str(file))
    assert done.returncode == 0, done.stderr
    assert "workers / one process" in done.stdout
    (row,) = json.loads(file.read_text(encoding="utf-8"))["rows"]
    assert row["bar"]["limit"] == 1.15
    assert row["value"] > 0
    assert row["details"]["episodes"] == 70
