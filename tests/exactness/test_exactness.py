"""The long comparison finds differences, reports them, and continues where it was interrupted."""

import concurrent.futures
import json
from pathlib import Path
from typing import Any

import pytest

from limberjack import registry
from tests.oracle import twins

pytestmark = pytest.mark.oracle

# Imported after the module above, which skips these tests where dm_control is not installed.
from tests.exactness import __main__ as command  # noqa: E402
from tests.exactness import comparisons, units  # noqa: E402
from tests.exactness.comparisons import KINDS, Kind, Tally, Task  # noqa: E402

_LEAST = min(registry.TASKS, key=lambda row: row.dof)


def test_a_change_of_one_unit_in_the_last_place_is_found() -> None:
    found = comparisons.self_check()
    assert "row 2, step 51, " in found["batches"]
    assert "dm_control has" in found["batches"]
    assert "humanoid:walk, seed 0, random actions, episode 0, step 51" in found["episodes"]


def test_a_difference_that_is_not_found_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparisons, "_change", lambda positions: None)
    monkeypatch.setattr(comparisons, "_EPISODES", 1)
    with pytest.raises(RuntimeError, match="planted into batches was not found"):
        comparisons.self_check()


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_compares_something(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(twins, "ACTIONS", ["random"])
    for name, value in {"_EPISODES": 1, "_SIZES": (1, 5), "_THREADS": (2,), "_STEPS": 130}.items():
        monkeypatch.setattr(comparisons, name, value)
    result = units.compared(units.Unit((_LEAST.domain, _LEAST.task), kind, 0))
    assert not result.difference
    assert result.comparisons > 0
    assert result.steps >= 500


@pytest.fixture
def plan(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """A function that runs short units in this process: the exit status and the summary."""
    calls: list[tuple[Task, int]] = []

    def differs(task: Task, part: int) -> Tally:
        calls.append((task, part))
        if len(calls) == 2:
            raise AssertionError("step 7, reward: 1.0, dm_control has 2.0")
        return Tally(comparisons=1, steps=10)

    for name in list(KINDS):
        monkeypatch.delitem(KINDS, name)
    monkeypatch.setitem(KINDS, "short", Kind(differs, 3, 10))
    monkeypatch.setattr(command, "self_check", lambda: {"short": "found"})
    monkeypatch.setattr(
        command, "_executor", lambda processes: concurrent.futures.ThreadPoolExecutor(1)
    )

    def run() -> tuple[int, dict[str, Any], int]:
        files = ["--ledger", str(tmp_path / "ledger"), "--summary", str(tmp_path / "summary")]
        before = len(calls)
        status = command.main([f"{_LEAST.domain}:{_LEAST.task} ", *files])
        return status, json.loads((tmp_path / "summary").read_text()), len(calls) - before

    return run


def test_a_difference_is_status_1_and_in_the_summary(plan: Any) -> None:
    status, summary, count = plan()
    assert (status, count, summary["differences"]) == (1, 3, 1)
    entry = summary["tasks"][f"{_LEAST.domain}:{_LEAST.task}"]["short"]
    assert (entry["comparisons"], entry["steps"]) == (2, 20)
    assert entry["first_difference"] == "step 7, reward: 1.0, dm_control has 2.0"
    assert summary["versions"]["dm_control"] == "1.0.50"


def test_only_units_that_have_not_passed_run_again(
    plan: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan()
    status, summary, count = plan()
    assert (status, count, summary["differences"]) == (0, 1, 0)
    assert plan()[2] == 0
    monkeypatch.setattr(command, "fingerprint", lambda: "of another source")
    assert plan()[2] == 3


def test_processes_are_replaced_without_losing_units(
    plan: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def executor(processes: int) -> concurrent.futures.Executor:
        made.append(processes)
        return concurrent.futures.ThreadPoolExecutor(1)

    monkeypatch.setattr(command, "_executor", executor)
    monkeypatch.setattr(command, "_UNITS_OF_A_PROCESS", 1)
    monkeypatch.setattr(command, "usable_cores", lambda: 2)
    assert plan()[2] == 3
    assert made == [2, 2]
