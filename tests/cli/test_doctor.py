"""`limberjack doctor`: what is printed, and the exit status."""

import contextlib
import dataclasses
import json
from collections.abc import Iterator, Mapping
from typing import Any

import pytest
import typer.testing

from limberjack import doctor
from limberjack.cli import app
from limberjack.doctor import exactness, packages
from limberjack.doctor.exactness import Amount, Comparison, Departure
from limberjack.doctor.probes import Answer
from limberjack.doctor.stored_bits import Kind

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
    "gpu": ["NVIDIA H200, 141 GB"],
}


def _ask(answers: Mapping[str, Answer]) -> Any:
    """Answers as where all works, but for the given probes."""
    return lambda probe, *_: answers.get(probe, Answer(_WORKS[probe]))


def _printed(monkeypatch: pytest.MonkeyPatch, answers: Mapping[str, Answer]) -> Any:
    """The result of the command where probes answer so."""
    diagnosis = doctor.examine(_ask(answers))
    monkeypatch.setattr(doctor, "examine", lambda ask: diagnosis)
    return typer.testing.CliRunner().invoke(app, ["doctor"])


def test_each_probe_is_named_as_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[tuple[str, float, float]] = []

    @contextlib.contextmanager
    def show_parts() -> Iterator[Any]:
        yield lambda *now: shown.append(now)

    monkeypatch.setattr("limberjack.cli.doctor.show_parts", show_parts)
    monkeypatch.setattr("limberjack.doctor.probes.ask", _ask({}))
    assert typer.testing.CliRunner().invoke(app, ["doctor"]).exit_code == 0
    assert shown[:2] == [("checking domains", 0, 9), ("checking core", 1, 9)]
    assert {part for part, _, _ in shown} == {f"checking {probe}" for probe in _WORKS}
    assert [asked for _, asked, _ in shown] == list(range(11))
    assert shown[-1][2] == 11  # a picture with each of two backends is asked for, too


def test_doctor_reports_a_machine_on_which_everything_works(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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


def test_the_exit_status_is_1_if_environments_do_not_step(monkeypatch: pytest.MonkeyPatch) -> None:
    result = _printed(monkeypatch, {"core": Answer(why="it crashed: SIGILL")})
    assert result.exit_code == 1
    assert "PROBLEM" in result.stdout
    assert result.stdout.count("it crashed: SIGILL") == 2


def test_doctor_reports_a_machine_on_which_nothing_works(
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


_HERE = Kind("Darwin", "arm64", "NEON", "fused", "2.4.6", "4.0.0")
_STORED = Kind("Linux", "x86_64", "AVX2", "rounded", "2.4.6", "4.0.0")
_FIRST = Departure(
    "walker:walk", "single", 3, "velocity", (Amount(20, 2e-15), Amount(60, 0.0)), 4e-12
)


def _bits(
    monkeypatch: pytest.MonkeyPatch, found: Comparison, *arguments: str
) -> typer.testing.Result:
    """The result of the command where the comparison is so."""
    monkeypatch.setattr(exactness, "compare", lambda on_progress: found)
    return typer.testing.CliRunner().invoke(app, ["doctor", "--exact", *arguments])


def test_equal_bits_are_reported_with_both_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    result = _bits(monkeypatch, Comparison(_STORED, _STORED, 51, (), ()))
    assert result.exit_code == 0
    assert result.stdout.splitlines() == [
        "here            Linux x86_64 with AVX2, rounded products, NumPy 2.4.6, MuJoCo 4.0.0",
        "stored          Linux x86_64 with AVX2, rounded products, NumPy 2.4.6, MuJoCo 4.0.0",
        "bits            bit-equal: 51 tasks, single and batched",
        "batches         bit-equal with single environments of this machine",
    ]


def test_the_first_departure_is_named_with_its_amounts_and_status_0(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    other = dataclasses.replace(_FIRST, task="walker:run", largest=5e-9)
    result = _bits(monkeypatch, Comparison(_HERE, _STORED, 51, (_FIRST, other), ()))
    assert result.exit_code == 0
    assert "here            Darwin arm64 with NEON" in result.stdout
    assert "bits            49 of 51 tasks are bit-equal" in result.stdout
    first = "walker:walk (single), step 3, velocity: by 2.0e-15 at step 20, equal at 60"
    assert f"first departure {first}" in result.stdout
    assert "largest         5.0e-09 at the stored steps of any task" in result.stdout
    assert "PROBLEM" not in result.stdout


def test_a_batch_that_differs_is_a_problem_with_status_1(monkeypatch: pytest.MonkeyPatch) -> None:
    batch = dataclasses.replace(_FIRST, how="batch")
    result = _bits(monkeypatch, Comparison(_HERE, _STORED, 51, (), (batch,)))
    assert result.exit_code == 1
    assert "PROBLEM         a batch differs from single environments" in result.stdout
    assert "walker:walk (batch), step 3, velocity" in result.stdout
    assert "bit-equal with single" not in result.stdout


def test_the_comparison_of_bits_becomes_json(monkeypatch: pytest.MonkeyPatch) -> None:
    result = _bits(monkeypatch, Comparison(_HERE, _STORED, 51, (_FIRST,), ()), "--json")
    found = json.loads(result.stdout)
    assert found["here"]["machine"] == "arm64"
    assert found["departures"][0]["amounts"][1] == {"step": 60, "difference": 0.0}
