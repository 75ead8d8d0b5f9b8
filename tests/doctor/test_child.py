"""Probes in a process of their own."""

import sys

import pytest

from limberjack.doctor import child
from tests.programs import run


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
