"""The benchmark of threads runs and reports its measurements; the figures are not tested."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import pages
import pytest
import threads

from tests.programs import run_benchmark


def _row(column: str, count: int, ours: float, theirs: float | None) -> dict[str, Any]:
    details = {"milliseconds_95": 1.234, "megabytes": 9.6}
    subject = f"walker walk, {count} threads"
    return {
        "measure": column,
        "subject": subject,
        "ours": ours,
        "theirs": theirs,
        "details": details,
    }


def test_the_table_of_the_page_is_the_one_that_was_measured() -> None:
    content = threads.RESULT.read_text(encoding="utf-8")
    assert pages.section_of(threads.PAGE, *threads.MARK) == threads.section(json.loads(content))


def test_the_table_has_a_line_for_each_number_of_threads_and_names_the_machine() -> None:
    rows = [
        _row("step", 1, 1000.4, 800.0),
        _row("inference", 1, 900.0, None),
        _row("training", 1, 70.0, None),
        _row("step", 2, 2000.0, None),
        _row("inference", 2, 1700.0, None),
        _row("training", 2, 71.0, None),
    ]
    machine = {"usable_cores": 2, "processor": "A Processor"}
    table = threads.section({"machine": machine, "settings": {"num_envs": 64}, "rows": rows})
    assert "of 64 rows, on 2 cores (A Processor):" in table
    lines = [line for line in table.splitlines() if line.startswith("| walker")]
    assert lines == [
        "| walker walk | 1 | 1,000 | 900 | 70 | 1.23 ms | 10 MB | 800 |",
        "| walker walk | 2 | 2,000 | 1,700 | 71 | 1.23 ms | 10 MB | - |",
    ]


@pytest.mark.slow  # learning is compiled, which takes most of a minute
def test_a_quick_run_measures_all_columns_or_names_the_packages(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    done = run_benchmark("threads.py", "--quick", "--json", str(file))
    if importlib.util.find_spec("sbx") is None:
        assert done.returncode == 1
        assert "training: needs the extra 'train': pip install " in done.stderr
        return
    assert done.returncode == 0, done.stderr
    assert "quick: the figures mean nothing" in done.stdout
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    assert {row["measure"] for row in rows} == {"step", "inference", "training"}
    assert all(row["ours"] > 0 for row in rows)
