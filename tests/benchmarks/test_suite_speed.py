"""The benchmark of the whole suite runs and reports its measurements; figures are not tested.

Of the benchmarks, `make test` runs this one, for all that share its report and options; `make
test-slow` runs every one.
"""

import json
from pathlib import Path

import pytest

from limberjack import suite
from tests.programs import report_without_places, run_benchmark

_CLASSES = Path(__file__).parents[2] / "benchmarks" / "results" / "classes.json"


def test_every_task_has_a_class() -> None:
    classes = json.loads(_CLASSES.read_text(encoding="utf-8"))
    assert list(classes) == [f"{domain}:{task}" for domain, task in suite.ALL_TASKS]
    assert all(microseconds > 0 for microseconds in classes.values())


def _measured(file: Path, *sections: str) -> tuple[str, str]:
    """The output of a quick run of some sections, and the text of its JSON."""
    options = [part for name in sections for part in ("--only", name)]
    done = run_benchmark(
        "suite_speed.py", "--quick", "--without-peers", *options, "--json", str(file)
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, file.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The output of a quick run, and the text of its JSON."""
    file = tmp_path_factory.mktemp("benchmarks") / "results" / "quick.json"
    return _measured(file, "batch", "size")


def test_one_command_prints_every_measure_with_its_bar(quick: tuple[str, str]) -> None:
    table, text = quick
    rows = json.loads(text)["rows"]
    assert [row["measure"] for row in rows] == ["batch / bare Batch", *["lines"] * 2]
    assert all(row["bar"] is not None and row["value"] is not None for row in rows)
    for row in rows:
        assert row["measure"] in table
        assert f"= {row['bar']['limit']:g}" in table
    (batch, *_) = rows
    assert batch["details"]["class"] in ("heavy", "toy")
    assert batch["subject"] == f"{':'.join(suite.ALL_TASKS[0])}, N=64"


def test_the_json_names_versions_and_machine_but_no_host_or_path(quick: tuple[str, str]) -> None:
    settings = report_without_places(quick[1])["settings"]
    assert settings["quick"] is True


@pytest.mark.slow
def test_the_memory_of_all_tasks_is_measured(tmp_path: Path) -> None:
    rows = json.loads(_measured(tmp_path / "quick.json", "memory")[1])["rows"]
    assert [row["measure"] for row in rows] == ["memory"] * 2
    assert all(row["bar"] is not None and row["value"] is not None for row in rows)
