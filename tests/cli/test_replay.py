"""`limberjack replay`: a recorded episode again, and where it differs."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.testing

from limberjack import suite
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


def test_a_recording_that_does_not_say_its_task_is_refused(tmp_path: Path) -> None:
    states = np.zeros((2, 5))
    Recording({}, {}, states[:1], np.zeros(1), states, {}).save(tmp_path / "bare.npz")
    result = _invoke("replay", str(tmp_path / "bare.npz"))
    assert result.exit_code == 2
    assert "does not say its domain, task, time_limit" in result.stderr
