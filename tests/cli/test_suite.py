"""`limberjack list`."""

import importlib
import json
import re

import pytest

from limberjack import registry, suite
from tests import plain_domain
from tests.cli.conftest import invoke


def test_list_has_a_row_for_each_task_with_its_sizes() -> None:
    result = invoke("list")
    assert result.exit_code == 0
    rows = [tuple(line.split()[:2]) for line in result.stdout.splitlines()[2:]]
    assert rows == list(suite.ALL_TASKS)
    assert re.search(r"humanoid +walk +benchmarking +21 +67 *$", result.stdout, re.MULTILINE)
    assert re.search(r"stacker +stack_4 +hard, extra +5 +63 *$", result.stdout, re.MULTILINE)


def test_a_narrow_terminal_leaves_nothing_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("limberjack.cli.output.is_terminal", lambda stream: True)
    monkeypatch.setenv("COLUMNS", "40")
    assert "run_pure_state" in invoke("list").stdout
    assert "…" not in invoke("policies").stdout


def test_list_as_json_has_an_object_for_each_task_with_the_sizes_of_the_table() -> None:
    result = invoke("list", "--json")
    assert result.exit_code == 0
    tasks = json.loads(result.stdout)
    assert [(task["domain"], task["task"]) for task in tasks] == list(suite.ALL_TASKS)
    for task, row in zip(tasks, registry.TASKS, strict=True):  # which has those of environments
        assert (task["action_size"], task["observation_size"]) == (row.actions, row.observations)
    assert {tuple(task) for task in tasks} == {
        ("domain", "task", "tags", "action_size", "observation_size")
    }
    (stacker,) = [task for task in tasks if task["task"] == "stack_4"]
    assert (stacker["domain"], stacker["tags"]) == ("stacker", ["hard", "extra"])


def test_an_installed_domain_that_cannot_be_listed_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(suite, "find_installed", lambda: {"swing": "it needs 'scipy'"})
    result = invoke("list")
    assert result.exit_code == 0
    assert result.stderr == "limberjack: domain 'swing' is left out: it needs 'scipy'\n"


def test_the_models_of_a_domain_that_was_assigned_are_compiled_for_their_sizes() -> None:
    name = "a_domain_of_these_tests"
    suite._DOMAINS[name] = importlib.import_module(plain_domain.__name__)
    try:
        tasks = json.loads(invoke("list", "--json").stdout)
    finally:
        del suite._DOMAINS[name]
    sizes = [
        (one["action_size"], one["observation_size"]) for one in tasks if one["domain"] == name
    ]
    assert sizes == [(1, 3)] * len(plain_domain.SUITE)
