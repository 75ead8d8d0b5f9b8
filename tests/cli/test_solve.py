"""`limberjack solve` and `limberjack replay`, called in this process."""

from pathlib import Path
from typing import Any

import typer.testing

from limberjack.cli import app
from limberjack.recording.episodes import Recording

_SOLVE = ["solve", "manipulator", "bring_ball", "--time-limit", "0.1", "--threads", "1"]


def _invoke(*arguments: str) -> Any:
    return typer.testing.CliRunner().invoke(app, list(arguments))


def test_solve_records_episodes_that_replay_plays_again(tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = _invoke(*_SOLVE, "--episodes", "2", "--seed", "3", "--out", str(out))
    assert result.exit_code == 0, result.output
    assert {"episode-3.npz", "episode-4.npz", "result.json"} <= {p.name for p in out.iterdir()}
    recording = Recording.load(out / "episode-4.npz")
    assert recording.about["task"] == "bring_ball"
    assert recording.about["seed"] == 4
    assert f"{recording.rewards.sum():.3f}" in result.stdout
    replayed = _invoke("replay", str(out / "episode-4.npz"))
    assert replayed.exit_code == 0, replayed.output
    assert "10 steps, return" in replayed.stdout
    assert "every bit the same" in replayed.stdout


def test_solve_shows_the_same_numbers_without_files() -> None:
    first, second = _invoke(*_SOLVE), _invoke(*_SOLVE)
    assert first.exit_code == 0
    assert first.stdout == second.stdout
    assert len(first.stdout.splitlines()) == 3


def test_solve_replaces_its_own_episodes_and_refuses_other_results(tmp_path: Path) -> None:
    assert _invoke(*_SOLVE, "--out", str(tmp_path)).exit_code == 0
    assert _invoke(*_SOLVE, "--episodes", "2", "--out", str(tmp_path)).exit_code == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    other = ["solve", "stacker", "stack_2", *_SOLVE[3:], "--out", str(tmp_path)]
    result = _invoke(*other)
    assert result.exit_code == 2
    assert "holds episode-1.npz, an episode of another `limberjack solve`" in result.stderr
    assert _invoke(*other, "--episodes", "2").exit_code == 2
    fewer = _invoke(*_SOLVE, "--seed", "1", "--out", str(tmp_path))
    assert fewer.exit_code == 2
    assert "holds episode-0.npz, an episode of another `limberjack solve`" in fewer.stderr
    run = ["run", *_SOLVE[1:5], "--policy", "planner", "--out", str(tmp_path)]
    assert _invoke(*run).exit_code == 2
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_solve_refuses_the_folder_of_an_evaluation_or_a_run(tmp_path: Path) -> None:
    for command, message in (
        ("evaluate", "holds an evaluation: choose another folder"),
        ("run", "holds results with policy 'zero', and these have 'planner'"),
    ):
        out = str(tmp_path / command)
        played = ["--time-limit", "0.02", "--out", out]
        counted = ["--seeds", "0:2"] if command == "evaluate" else []
        assert _invoke(command, *_SOLVE[1:3], *played, *counted).exit_code == 0
        result = _invoke(*_SOLVE, "--out", out)
        assert result.exit_code == 2
        assert message in result.stderr
