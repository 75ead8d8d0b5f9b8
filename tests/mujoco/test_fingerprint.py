"""Fingerprints of models, and versions."""

import subprocess
import sys

import pytest

from limberjack import suite
from limberjack.mujoco.fingerprint import fingerprint, versions

_PRINT_FINGERPRINT = """
from limberjack import suite
from limberjack.mujoco.fingerprint import fingerprint
print(fingerprint(suite.load("manipulator", "insert_peg").physics.model._official))
"""


def _fingerprint(domain: str, task: str) -> str:
    return fingerprint(suite.load(domain, task).physics.model._official)


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
    before = fingerprint(physics.model._official)
    assert callable(change)
    change(physics.model.ptr)
    assert fingerprint(physics.model._official) != before
