"""Probes, called in this process: what they return, and how an error becomes an answer."""

import json
import sys
from pathlib import Path

import pytest

from limberjack.doctor import probes
from tests.programs import run


def test_an_answer_is_written_whole_with_the_value_or_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken() -> None:
        raise OSError("no such\n  library")

    def silent() -> None:
        raise ValueError

    file = tmp_path / "answer.json"
    for probe, expected in (
        (lambda: {"steps": 3}, {"value": {"steps": 3}}),
        (broken, {"why": "OSError: no such library"}),
        (silent, {"why": "ValueError"}),
    ):
        monkeypatch.setattr(probes, "core", probe)
        probes.answer("core", str(file))
        assert json.loads(file.read_text(encoding="utf-8")) == expected
        assert [path.name for path in tmp_path.iterdir()] == ["answer.json"]


def test_the_core_steps_a_short_episode() -> None:
    assert probes.core() == {"steps": 17}  # of 0.015 s


def test_numbers_that_are_not_finite_are_reported_with_the_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from limberjack.suite import dog

    monkeypatch.setattr(dog.Stand, "reward_of", lambda self, terms: float("nan"))
    with pytest.raises(RuntimeError, match=r"dog:\w+: step 1 returned a number"):
        probes.core()


def test_the_version_of_an_unusual_ffmpeg_is_unknown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho libav 12", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setattr(probes, "find_ffmpeg", lambda: str(program))
    assert probes.ffmpeg() == "of an unknown version"
    program.write_text("#!/bin/sh\necho ffmpeg version 9.1 built", encoding="utf-8")
    assert probes.ffmpeg() == "9.1"


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
    monkeypatch.setattr(probes, "_PROGRAM", program)
    answer = probes.ask("core", limit=1.0 if "100" in program else 60.0)
    assert answer.value is None
    assert answer.why is not None
    assert answer.why == reason


def test_a_probe_that_raises_is_answered_with_its_error() -> None:
    answer = probes.ask("drawing", {"MUJOCO_GL": "disable"})
    assert answer.value is not None
    assert "switched off" in answer.value["why"]
    assert probes.ask("no_such_probe").why == "KeyError: 'no_such_probe'"


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
