"""Tests of limberjack.doctor and of the command that prints what it finds."""

import dataclasses
import email.message
import importlib.metadata
import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import typer.testing
from programs import run

import limberjack
from limberjack import doctor
from limberjack.cli import app
from limberjack.doctor import child, packages
from limberjack.doctor.child import Answer
from limberjack.utils import cores

_REPOSITORY = Path(__file__).parents[1]
_WORKS: dict[str, Any] = {
    "core": {"steps": 10},
    "threads": {
        "domain": "humanoid",
        "task": "stand",
        "num_envs": 64,
        "recommended": 2,
        "steps_per_second": [[1, 1000.0], [2, 1990.0], [4, 2000.0]],
    },
    "backends": ["egl", "osmesa"],
    "drawing": {"name": "egl", "renderer": "llvmpipe", "vendor": "Mesa"},
    "devices": ["NVIDIA H100", None],
    "ffmpeg": "7.0.2",
    "domains": {"found": {"swing": "my_package.swing"}, "problems": {}},
    "dm_control": "loads",
}


def _ask(answers: Mapping[str, Answer]) -> Any:
    """Answers as where all works, but for the given probes."""
    return lambda probe, *_: answers.get(probe, Answer(_WORKS[probe]))


def _printed(monkeypatch: pytest.MonkeyPatch, answers: Mapping[str, Answer]) -> Any:
    """The result of the command where probes answer so."""
    diagnosis = doctor.examine(_ask(answers))
    monkeypatch.setattr(doctor, "examine", lambda: diagnosis)
    return typer.testing.CliRunner().invoke(app, ["doctor"])


@pytest.fixture(scope="module")
def here() -> dict[str, Any]:
    """What the command finds on this machine, with a MUJOCO_GL that is nonsense."""
    done = subprocess.run(
        [sys.executable, "-m", "limberjack", "doctor", "--json"],
        env={**os.environ, "MUJOCO_GL": "nonsense"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_the_core_steps_and_threads_are_recommended(here: dict[str, Any]) -> None:
    assert here["core"] == {"works": True, "version": packages.version("mujoco-core"), "why": ""}
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
        assert backend["works"] or ";" in backend["why"]  # what to do stands behind it


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
def test_a_backend_that_draws_is_found_with_its_driver(here: dict[str, Any]) -> None:
    (egl,) = [backend for backend in here["backends"] if backend["name"] == "egl"]
    if not egl["works"]:
        pytest.skip(f"EGL does not work here: {egl['why']}")
    assert egl["renderer"]
    assert egl["vendor"]
    # Mesa's draws without any device, too; but where devices are listed, they are its.
    assert not here["devices"] or egl["renderer"] in here["devices"]


def test_an_installed_dm_control_is_tried(here: dict[str, Any]) -> None:
    found = here["dm_control"]
    assert found["version"] == packages.version("dm_control")
    assert found["works"] is not bool(found["why"])
    if found["version"] == "1.0.50":
        # Its table of array sizes names fields that MuJoCo 4 does not have; or OpenGL stops it.
        assert not found["works"]


def test_extras_are_those_of_the_projects_metadata(here: dict[str, Any]) -> None:
    with open(_REPOSITORY / "pyproject.toml", "rb") as file:
        project = tomllib.load(file)["project"]
    found = {extra["name"]: extra for extra in here["extras"]}
    assert set(found) == set(project["optional-dependencies"])
    for name, extra in found.items():
        assert extra["command"] == f"pip install 'limberjack[{name}]'"
    # This very test needs it.
    assert "pytest" not in found["test"]["missing"]


def test_extras_come_from_the_metadata_where_it_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    metadata = email.message.Message()
    for name in ("draw", "all"):
        metadata["Provides-Extra"] = name
    for requirement in (
        "numpy",
        'no-such-thing>=2; extra == "draw"',
        'pytest; extra == "draw"',
        'old-thing; python_version < "3.9" and extra == "draw"',
        'new-thing; python_version >= "3.9" and extra == "draw"',
        'limberjack[draw]; extra == "all"',
        'other_thing[part]<3 ; extra == "all"',
    ):
        metadata["Requires-Dist"] = requirement
    monkeypatch.setattr(importlib.metadata, "metadata", lambda _: metadata)
    draw, all_ = packages.extras()
    assert (draw.name, draw.missing) == ("draw", ("new-thing", "no-such-thing"))
    assert not draw.is_installed
    assert all_.missing == ("new-thing", "no-such-thing", "other_thing")
    assert all_.command == "pip install 'limberjack[all]'"


def test_an_older_mujoco_beside_mujoco_core_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "version", {"mujoco": "3.3.0", "mujoco-core": "4.0.0"}.get)
    (problem,) = packages.clashes()
    assert "mujoco 3.3.0 is installed beside mujoco-core 4.0.0" in problem
    assert "pip uninstall" in problem
    for versions in ({"mujoco": "4.0.0", "mujoco-core": "4.0.0"}, {"mujoco-core": "4.0.0"}):
        monkeypatch.setattr(packages, "version", versions.get)
        assert packages.clashes() == []


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        ("import os; os.kill(os.getpid(), 11)", "it crashed: SIGSEGV"),
        ("import os, sys; sys.stderr.write('a driver died'); sys.stderr.flush(); os.abort()",
         "it crashed: SIGABRT (a driver died)"),
        ("import sys; sys.exit('no such library')", "no such library"),
        ("import os; os._exit(3)", "it ended with status 3"),
        ("import time; time.sleep(100)", "no answer within 1 s"),
        # What it started and left behind is not waited for.
        ("import subprocess, sys; subprocess.Popen([sys.executable, '-c', "
         "'import time; time.sleep(20)']); sys.exit('gone')", "gone"),
    ],
)  # fmt: skip
@pytest.mark.skipif(sys.platform == "win32", reason="signals are POSIX's")
def test_a_probe_that_dies_or_hangs_is_reported(
    monkeypatch: pytest.MonkeyPatch, program: str, reason: str
) -> None:
    monkeypatch.setattr(child, "_PROGRAM", program)
    answer = child.ask("core", limit=1.0 if "100" in program else 60.0)
    assert answer.value is None
    assert answer.why is not None
    assert answer.why == reason


def test_a_probe_that_raises_is_answered_with_its_error() -> None:
    answer = child.ask("drawing", {"MUJOCO_GL": "disable"})
    assert answer.value is not None
    assert "switched off" in answer.value["why"]
    assert child.ask("no_such_probe").why == "KeyError: 'no_such_probe'"


def test_where_all_works_the_command_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "version", lambda _: "1.0")
    result = _printed(monkeypatch, {})
    assert result.exit_code == 0
    for text in (
        "num_threads=2 for 64 rows of humanoid:stand",
        "by egl: llvmpipe, Mesa",
        "EGL device 0  NVIDIA H100",
        "EGL device 1  gives no OpenGL",
        "7.0.2",
        "domain swing    my_package.swing",
        "1.0 loads here",
    ):
        assert text in result.stdout
    assert "PROBLEM" not in result.stdout


def test_a_domain_that_cannot_be_used_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {"found": {}, "problems": {"swing": "my_package.swing: SUITE is missing"}}
    result = _printed(monkeypatch, {"domains": Answer(found)})
    assert result.exit_code == 0
    problem = "domain 'swing' of an installed package cannot be used: my_package.swing: SUITE is"
    assert problem in result.stdout


def test_where_the_core_does_not_work_the_exit_status_is_1(monkeypatch: pytest.MonkeyPatch) -> None:
    result = _printed(monkeypatch, {"core": Answer(why="it crashed: SIGILL")})
    assert result.exit_code == 1
    assert "PROBLEM" in result.stdout
    assert result.stdout.count("it crashed: SIGILL") == 2


def test_where_nothing_works_there_is_a_diagnosis_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answers = {name: Answer(why=f"{name} is broken") for name in _WORKS}
    diagnosis = doctor.examine(_ask(answers))
    assert not diagnosis.core.works
    assert diagnosis.threads.recommended is None
    assert (diagnosis.backends, diagnosis.devices) == ((), ())
    assert json.loads(json.dumps(dataclasses.asdict(diagnosis)))["versions"]
    result = _printed(monkeypatch, answers)
    for name in ("core", "threads", "drawing", "ffmpeg", "domains"):
        assert f"{name} is broken" in result.stdout


def test_pictures_that_cannot_be_drawn_do_not_fail_the_core(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nothing = Answer({"name": "egl", "why": "libEGL.so.1 cannot be loaded; install it"})
    result = _printed(monkeypatch, {"drawing": nothing})
    assert result.exit_code == 0
    assert "PROBLEM" in result.stdout
    assert "libEGL.so.1 cannot be loaded; install it" in result.stdout


def test_asking_imports_nothing_heavy() -> None:
    assert (
        run("""
        import sys
        from limberjack import doctor
        doctor.packages.versions(), doctor.packages.extras()
        print([name for name in ("mujoco", "dm_env", "OpenGL") if name in sys.modules])
    """)
        == "[]\n"
    )
