"""The bars beside dm_control are measured, and memory stays flat; no other figure is tested."""

import importlib.util
import json
import sys
from typing import Any

import pytest

from tests.programs import run_benchmark

# They take seconds each, and share their report and options with test_quick_runs.py.
pytestmark = pytest.mark.slow

_TASKS = ["humanoid:stand", "humanoid:walk"]  # of a quick run

_OF_EACH_TASK = ["steps per second", "added to MuJoCo's calls", "load / compile", "reset"]
_OF_ALL = ["import adds", "OpenGL modules", "first load / compile", "memory grows by"]


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """The output of a quick run, and the text of its JSON."""
    file = tmp_path_factory.mktemp("benchmarks") / "results" / "quick.json"
    done = run_benchmark("overhead.py", "--quick", "--json", str(file))
    assert done.returncode == 0, done.stderr
    return done.stdout, file.read_text(encoding="utf-8")


def test_the_json_has_every_figure_with_its_bar(quick: tuple[str, str]) -> None:
    rows = json.loads(quick[1])["rows"]
    for measure in _OF_EACH_TASK:
        subjects = [row["subject"] for row in rows if row["measure"] == measure]
        assert [subject for subject in subjects if ":" in subject] == _TASKS
    for row in rows:
        if row["measure"] in [*_OF_EACH_TASK, *_OF_ALL]:
            assert row["bar"] is not None
            # Other systems do not report the memory of a process in a file.
            if sys.platform == "linux" or row["measure"] != "memory grows by":
                assert row["ours"] is not None


def test_imports_are_measured_of_the_suite_and_of_the_package_alone(
    quick: tuple[str, str],
) -> None:
    rows = [row for row in json.loads(quick[1])["rows"] if row["measure"] == "import adds"]
    bars = {row["subject"]: row["bar"]["limit"] for row in rows}
    assert bars == {"import limberjack.suite": 50, "import limberjack": 15}
    for row in rows:
        assert row["details"]["base_ms"]["median"] > 0


def test_comparisons_with_dm_control_run_where_it_is_installed(quick: tuple[str, str]) -> None:
    table, text = quick
    rows: list[dict[str, Any]] = json.loads(text)["rows"]
    compared = [row for row in rows if row["measure"] in ("steps per second", "reset")]
    is_installed = importlib.util.find_spec("dm_control") is not None
    assert [row["is_met"] is not None for row in compared] == [is_installed] * len(compared)
    assert ("not measured" in table) is not is_installed


def test_memory_stays_flat_over_steps_and_loads() -> None:
    # A tenth of the benchmark's own work.
    done = run_benchmark("memory.py", "--steps", "100000", "--loads", "500", "--cycles", "300")
    assert done.returncode == 0, done.stdout + done.stderr
