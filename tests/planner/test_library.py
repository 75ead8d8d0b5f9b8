"""The cost that a task names, and the files that decide what the planner does."""

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import limberjack.planner
from limberjack import suite
from limberjack.planner import Cost
from limberjack.planner.library import cost_for, sources_for

from .planned import PLANNED, SINGLE_STAGE

_PLANNER = Path(limberjack.planner.__file__).parent


@pytest.mark.parametrize(("domain", "task"), PLANNED + SINGLE_STAGE)
def test_every_task_of_the_suite_names_its_cost(domain: str, task: str) -> None:
    named = suite.load(domain, task).task
    cost = cost_for(named)
    assert f"{type(cost).__module__}:{type(cost).__name__}" == named.planner_cost
    assert cost.task is named


def test_no_other_task_names_a_cost() -> None:
    named = [
        (domain, task)
        for domain, task in suite.ALL_TASKS
        if suite.load(domain, task, {"random": 0}).task.planner_cost is not None
    ]
    assert sorted(named) == sorted(PLANNED + SINGLE_STAGE)


def test_the_files_are_all_of_the_planners() -> None:
    files = sources_for(suite.load("humanoid", "stand").task)
    assert set(files) == set(_PLANNER.rglob("*.py"))
    assert files == sorted(files)


def test_the_file_of_a_cost_outside_the_planner_comes_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cost_of_mine.py").write_text(
        "from limberjack.planner import Cost\nclass Still(Cost): pass\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    task = SimpleNamespace(planner_cost="cost_of_mine:Still")
    assert isinstance(cost_for(task), Cost)
    assert sources_for(task)[-1] == tmp_path / "cost_of_mine.py"
    del sys.modules["cost_of_mine"]


def test_a_task_without_a_cost_is_told_what_to_write() -> None:
    for find in (cost_for, sources_for):
        with pytest.raises(ValueError, match="write a subclass of limberjack"):
            find(SimpleNamespace())


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("no_such_module:Cost", "No module named 'no_such_module'"),
        ("limberjack.planner.cost:Cots", "no attribute 'Cots'"),
        ("limberjack.planner.cost", "expected 'module:Class'"),
        ("limberjack.planner.cost:Settings", "not a subclass of limberjack.planner.Cost"),
    ],
)
def test_a_cost_that_cannot_be_found_is_one_sentence(name: str, message: str) -> None:
    with pytest.raises(ValueError, match="planner_cost of SimpleNamespace is") as error:
        cost_for(SimpleNamespace(planner_cost=name))
    assert message in str(error.value)
