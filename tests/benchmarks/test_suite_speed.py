"""The benchmark of the whole suite runs and reports its measurements; figures are not tested."""

import json
from pathlib import Path

from limberjack import suite
from tests.programs import run_benchmark

_CLASSES = Path(__file__).parents[2] / "benchmarks" / "results" / "classes.json"


def test_every_task_has_a_class() -> None:
    classes = json.loads(_CLASSES.read_text(encoding="utf-8"))
    assert list(classes) == [f"{domain}:{task}" for domain, task in suite.ALL_TASKS]
    assert all(microseconds > 0 for microseconds in classes.values())


def test_batches_memory_and_lines_are_measured(tmp_path: Path) -> None:
    file = tmp_path / "quick.json"
    sections = [part for name in ("batch", "memory", "size") for part in ("--only", name)]
    done = run_benchmark(
        "suite_speed.py", "--quick", "--without-peers", *sections, "--json", str(file)
    )
    assert done.returncode == 0, done.stderr
    rows = json.loads(file.read_text(encoding="utf-8"))["rows"]
    assert [row["measure"] for row in rows] == [
        "batch / bare Batch",
        *["memory"] * 2,
        *["lines"] * 2,
    ]
    assert all(row["bar"] is not None and row["value"] is not None for row in rows)
    (batch, *_) = rows
    assert batch["details"]["class"] in ("heavy", "toy")
    assert batch["subject"] == f"{':'.join(suite.ALL_TASKS[0])}, N=64"
