"""The files that a run leaves behind."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from limberjack import report, suite
from limberjack.episodes import Episode
from limberjack.mujoco.fingerprint import fingerprint, versions

_EPISODES = [Episode(4, None, np.array([0.25, 0.5])), Episode(5, "in_hand", np.array([1.0]))]


_PRINT_FINGERPRINT = """
from limberjack import report, suite
print(fingerprint(suite.load("manipulator", "insert_peg").physics.model._model))
"""


def _fingerprint(domain: str, task: str) -> str:
    return fingerprint(suite.load(domain, task).physics.model._model)


def test_a_result_lists_episodes_versions_and_fingerprint(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    report.write_result(path, {"task": "walk"}, _EPISODES, "abc")
    result = json.loads(path.read_text())
    assert result == {
        "task": "walk",
        "episodes": [
            {"seed": 4, "return": 0.75, "length": 2},
            {"seed": 5, "return": 1.0, "length": 1, "start": "in_hand"},
        ],
        "versions": versions(),
        "fingerprint": "abc",
    }


def test_a_result_is_valid_json_whatever_the_return(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    report.write_result(path, {}, [Episode(0, None, np.array([np.nan]))], "")
    assert "NaN" not in path.read_text()
    assert json.loads(path.read_text())["episodes"][0]["return"] is None


def test_versions_name_what_numbers_depend_on() -> None:
    assert set(versions()) == {"limberjack", "mujoco", "numpy", "python"}


def test_a_fingerprint_is_the_same_in_every_process() -> None:
    printed = {
        subprocess.run(
            [sys.executable, "-c", _PRINT_FINGERPRINT],
            check=True,
            capture_output=True,
            text=True,
            timeout=120,
        ).stdout.strip()
        for _ in range(2)
    }
    assert printed == {_fingerprint("manipulator", "insert_peg")}


def test_each_model_has_its_own_fingerprint() -> None:
    models = [("humanoid", "walk"), ("stacker", "stack_2"), ("stacker", "stack_4")]
    models += [("manipulator", task) for task in suite.TASKS_BY_DOMAIN["manipulator"]]
    assert len({_fingerprint(*model) for model in models}) == len(models)


@pytest.mark.parametrize(
    "change",
    [
        lambda model: model.body_mass.__setitem__(3, 1.5),
        lambda model: setattr(model.opt, "timestep", 0.004),
        lambda model: setattr(model.vis.map, "znear", 0.5),
        lambda model: setattr(model.stat, "extent", 7.0),
    ],
    ids=["an array", "an option", "a visual setting", "a statistic"],
)
def test_a_fingerprint_notices_a_change_of(change: object) -> None:
    physics = suite.load("humanoid", "walk").physics
    before = fingerprint(physics.model._model)
    assert callable(change)
    change(physics.model.ptr)
    assert fingerprint(physics.model._model) != before
