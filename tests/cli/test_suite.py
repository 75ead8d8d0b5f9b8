"""`limberjack list`."""

import json
import math
import re
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer.testing

from limberjack import suite
from limberjack.cli import app
from limberjack.mujoco.wrapper import sharing


def _invoke(*arguments: str) -> Any:
    """The result of the command in this process, without a terminal."""
    return typer.testing.CliRunner().invoke(app, list(arguments))


@pytest.fixture(scope="module", autouse=True)
def _models_kept() -> Iterator[None]:
    """The models of all tasks stay compiled; the package keeps fewer, and each list needs all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sharing, "_MOST_KEPT", 2**30)
        yield


@pytest.fixture(autouse=True)
def _search_path() -> Iterator[None]:
    """The command adds the working directory to the module search path: that is undone."""
    before = list(sys.path)
    yield
    sys.path[:] = before


def test_list_has_a_row_for_each_task_with_its_sizes() -> None:
    result = _invoke("list")
    assert result.exit_code == 0
    rows = [tuple(line.split()[:2]) for line in result.stdout.splitlines()[2:]]
    assert rows == list(suite.ALL_TASKS)
    assert re.search(r"humanoid +walk +benchmarking +21 +67 *$", result.stdout, re.MULTILINE)
    assert re.search(r"stacker +stack_4 +hard, extra +5 +63 *$", result.stdout, re.MULTILINE)


def test_list_as_json_has_an_object_for_each_task() -> None:
    result = _invoke("list", "--json")
    assert result.exit_code == 0
    tasks = json.loads(result.stdout)
    assert [(task["domain"], task["task"]) for task in tasks] == list(suite.ALL_TASKS)
    for task in tasks:
        environment = suite.load(task["domain"], task["task"])
        assert task["action_size"] == math.prod(environment.action_spec().shape)
        sizes = (math.prod(spec.shape) for spec in environment.observation_spec().values())
        assert task["observation_size"] == sum(sizes)
    assert {tuple(task) for task in tasks} == {
        ("domain", "task", "tags", "action_size", "observation_size")
    }
    (stacker,) = [task for task in tasks if task["task"] == "stack_4"]
    assert (stacker["domain"], stacker["tags"]) == ("stacker", ["hard", "extra"])
