"""An examination of this machine, with a MUJOCO_GL that names no backend."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest

import limberjack
from limberjack.doctor import examine, packages
from limberjack.doctor.probes import Answer
from limberjack.utils import cores

# The command with a small task, in its probes as well; the largest one is in test_probes.py.
_COMMAND = """
import sys
from limberjack.cli import main
from limberjack.doctor import probes

small = "probes._TASK = 'pendulum', 'swingup'"
exec(small)
probes._PROGRAM = probes._PROGRAM.replace("probes.answer", small + "; probes.answer")
main()
"""


@pytest.fixture(scope="module")
def here() -> dict[str, Any]:
    """The JSON that the command prints on this machine, with a MUJOCO_GL that names no backend."""
    done = subprocess.run(
        [sys.executable, "-c", _COMMAND, "doctor", "--json"],
        env={**os.environ, "MUJOCO_GL": "nonsense"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_the_core_steps_and_threads_are_recommended(here: dict[str, Any]) -> None:
    assert here["core"] == {"works": True, "version": packages.version("mujoco"), "why": ""}
    assert here["versions"]["limberjack"] == limberjack.__version__
    assert (here["usable_cores"], here["total_cores"]) == (cores.usable_cores(), os.cpu_count())
    speeds = {int(n): speed for n, speed in here["threads"]["steps_per_second"].items()}
    assert here["threads"]["recommended"] in speeds
    assert 1 in speeds
    assert min(speeds.values()) > 0
    assert max(speeds) == min(cores.usable_cores(), here["threads"]["num_envs"])


def test_each_backend_is_tried_by_itself_whatever_the_environment_says(
    here: dict[str, Any],
) -> None:
    assert here["variables"]["MUJOCO_GL"] == "nonsense"
    assert not here["drawing"]["works"]
    assert "MUJOCO_GL='nonsense'" in here["drawing"]["why"]
    assert any("no pictures" in problem for problem in here["problems"])
    tried = [backend["name"] for backend in here["backends"]]
    if sys.platform == "linux":
        assert tried == ["egl", "osmesa", "glfw"]
    for backend in here["backends"]:
        assert backend["works"] is not bool(backend["why"])
        assert "nonsense" not in backend["why"]
        assert backend["works"] or ";" in backend["why"]  # the remedy follows the reason


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
def test_a_backend_that_draws_is_found_with_its_driver(here: dict[str, Any]) -> None:
    (egl,) = [backend for backend in here["backends"] if backend["name"] == "egl"]
    if not egl["works"]:
        pytest.skip(f"EGL does not work here: {egl['why']}")
    assert egl["renderer"]
    assert egl["vendor"]
    # Mesa's EGL draws without a device too; but where devices are listed, one of them draws.
    assert not here["devices"] or egl["renderer"] in here["devices"]


def test_an_installed_dm_control_is_tried(here: dict[str, Any]) -> None:
    found = here["dm_control"]
    assert found["version"] == packages.version("dm_control")
    assert found["works"] is not bool(found["why"])
    if found["version"] == "1.0.50":
        # Its table of array sizes names fields that MuJoCo 4 lacks; or OpenGL stops it.
        assert not found["works"]
        assert "install dm_control in a virtual environment of its own" in found["why"]


def test_a_clash_of_packages_is_reported_without_the_failures_that_it_causes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def ask(probe: str, *_: object) -> Answer:
        return Answer(why="ImportError: no core")

    assert len(examine(ask).problems) == 3
    monkeypatch.setattr(packages, "clashes", lambda: ["MuJoCo 4.0.0 lacks 143 of its files"])
    diagnosis = examine(ask)
    assert diagnosis.problems == ("MuJoCo 4.0.0 lacks 143 of its files",)
    assert not diagnosis.core.works
