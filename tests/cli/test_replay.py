"""`limberjack replay`: a recorded episode again, and where it differs."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.testing

from limberjack import report, suite
from limberjack.cli import app
from limberjack.planner.record import Recording, record_episode

_SOLVE = ["solve", "manipulator", "bring_ball", "--time-limit", "0.1", "--threads", "1"]


def _invoke(*arguments: str) -> Any:
    return typer.testing.CliRunner().invoke(app, list(arguments))


def test_replay_says_where_a_recording_differs(tmp_path: Path) -> None:
    _invoke(*_SOLVE, "--out", str(tmp_path))
    path = tmp_path / "episode-0.npz"
    recording = Recording.load(path)
    recording.actions[4] = -recording.actions[4] + 0.1
    recording.about["versions"]["mujoco"] = "3.2.1"
    recording.about["fingerprint"] = "0"
    recording.save(path)
    result = _invoke("replay", str(path), "--out", str(tmp_path / "again"))
    assert result.exit_code == 1
    assert not list((tmp_path / "again").iterdir())
    assert "step 4: the state differs from the recorded one" in result.stderr
    assert "It was recorded with mujoco 3.2.1, here" in result.stderr
    assert "; a model with another fingerprint." in result.stderr


def test_a_recording_of_another_patch_version_is_replayed(tmp_path: Path) -> None:
    _invoke(*_SOLVE, "--out", str(tmp_path))
    path = tmp_path / "episode-0.npz"
    recording = Recording.load(path)
    series, _, patch = recording.about["versions"]["mujoco"].rpartition(".")
    recording.about["versions"]["mujoco"] = f"{series}.{patch}7"
    recording.save(path)
    result = _invoke("replay", str(path), "--out", str(tmp_path / "again"))
    assert result.exit_code == 0, result.stderr
    assert "every bit the same" in result.stdout
    written = json.loads((tmp_path / "again" / "result.json").read_text(encoding="utf-8"))
    assert written["versions"] == report.versions()


def test_replay_writes_what_a_run_writes_but_not_over_the_recordings_own(tmp_path: Path) -> None:
    _invoke(*_SOLVE, "--out", str(tmp_path))
    before = (tmp_path / "result.json").read_bytes()
    path = tmp_path / "episode-0.npz"
    result = _invoke("replay", str(path), "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "lies beside a result.json that tells of all its episodes" in result.stderr
    assert (tmp_path / "result.json").read_bytes() == before
    assert _invoke("replay", str(path), "--out", str(tmp_path / "again")).exit_code == 0
    found = json.loads((tmp_path / "again" / "result.json").read_text())["episodes"]
    assert found == json.loads(before)["episodes"]


def test_a_recording_that_a_program_made_can_be_filmed(tmp_path: Path) -> None:
    env = suite.load("stacker", "stack_2", {"random": 1, "time_limit": 0.1})
    about = {"domain": "stacker", "task": "stack_2", "time_limit": 0.1}
    record_episode(env, lambda: np.zeros(5), about).save(tmp_path / "mine.npz")
    result = _invoke("replay", str(tmp_path / "mine.npz"), "--out", str(tmp_path / "out"))
    assert result.exit_code == 0, result.output
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["solve", "manipulator", "bring_bal"], "Did you mean 'bring_ball'?"),
        ([*_SOLVE, "--time-limit", "inf"], "--time-limit is inf; expected a number of seconds"),
        ([*_SOLVE, "--seed", str(2**32 - 1), "--episodes", "2"], "the last episode's seed is"),
        (["replay", "nothing.npz"], "nothing.npz"),
    ],
)
def test_what_cannot_be_played_is_refused(arguments: list[str], message: str) -> None:
    result = _invoke(*arguments)
    assert result.exit_code == 2
    assert message in result.stderr


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"domain": ["stacker"]}, "says that its domain is ['stacker']"),
        ({"task": None}, "says that its task is None"),
        ({"task": "stack_3"}, "Did you mean"),
        ({"time_limit": None}, "says that its time_limit is None"),
        ({"time_limit": True}, "says that its time_limit is True"),
        ({"time_limit": float("nan")}, "says that its time_limit is nan; expected seconds"),
        ({"time_limit": float("inf")}, "says that its time_limit is inf; expected seconds"),
        ({"time_limit": -1}, "says that its time_limit is -1; expected seconds"),
        ({"time_limit": 10**400}, "expected seconds"),
        ({"seed": "3"}, "says that its seed is '3'"),
        ({"versions": ["4.0.0"]}, "says that its versions is ['4.0.0']"),
        ({"fingerprint": 7}, "says that its fingerprint is 7"),
        ({"domain": "humanoid", "task": "stand"}, "it is of another task or model"),
    ],
)
def test_a_forged_recording_is_one_line_and_status_2(
    about: dict[str, Any], message: str, tmp_path: Path
) -> None:
    env = suite.load("stacker", "stack_2", {"random": 1, "time_limit": 0.05})
    told = {"domain": "stacker", "task": "stack_2", "time_limit": 0.05, **about}
    path = tmp_path / "forged.npz"
    record_episode(env, lambda: np.zeros(5), told).save(path)
    result = _invoke("replay", str(path), "--out", str(tmp_path / "out"))
    assert result.exit_code == 2, result.output
    assert result.stderr.startswith("limberjack: ")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("name", ["actions", "rewards", "states"])
def test_arrays_of_other_shapes_are_one_line(name: str, tmp_path: Path) -> None:
    env = suite.load("stacker", "stack_2", {"random": 1, "time_limit": 0.05})
    about = {"domain": "stacker", "task": "stack_2", "time_limit": 0.05}
    recording = record_episode(env, lambda: np.zeros(5), about)
    wide = np.repeat(getattr(recording, name)[:, None], 2, axis=1)
    path = tmp_path / "forged.npz"
    dataclasses.replace(recording, **{name: wide}).save(path)
    result = _invoke("replay", str(path))
    assert result.exit_code == (1 if name == "states" else 2), result.output
    assert result.stderr.count("\n") == 1


def test_a_damaged_file_is_one_line_and_status_2(tmp_path: Path) -> None:
    path = tmp_path / "damaged.npz"
    for content in (b"", b"PK\x03\x04", b"\x93NUMPY", bytes(1000)):
        path.write_bytes(content)
        result = _invoke("replay", str(path))
        assert result.exit_code == 2, result.output
        assert result.stderr.startswith(f"limberjack: {path} is no recording of an episode")
        assert result.stderr.count("\n") == 1


def test_a_recording_that_does_not_say_its_task_is_refused(tmp_path: Path) -> None:
    states = np.zeros((2, 5))
    Recording({}, {}, states[:1], np.zeros(1), states, {}).save(tmp_path / "bare.npz")
    result = _invoke("replay", str(tmp_path / "bare.npz"))
    assert result.exit_code == 2
    assert "does not say its domain, task, time_limit" in result.stderr
