"""The part that `run` and `solve` share: seeds, files and exit statuses."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack import rollout
from limberjack.cli.output import FAILED, INTERRUPTED
from limberjack.cli.playing import Playing
from limberjack.policies import PolicyError
from limberjack.rollout import Episode, OnStep, Step


class _Scripted(Playing):
    """Plays nothing: an episode of two rewards, or an error in the second one."""

    failure: BaseException | None = None

    def _prepare(self, environment: Any) -> None:
        self.played: list[int] = []

    def _play_in(self, environment: Any, seed: int, on_step: OnStep) -> Episode:
        time_step = environment.reset()
        if self.failure is not None and self.played:
            raise self.failure
        self.played.append(seed)
        for step in range(3):
            on_step(Step(step, 0.5 * step, time_step, None))
        return rollout.Episode(seed, None, np.array([0.5, 0.5]))


def _made(
    seeds: range = range(4, 7), time_limit: float | None = None, out: Path | None = None
) -> _Scripted:
    return _Scripted("humanoid", "stand", seeds, "scripted", time_limit, out)


def test_each_seed_is_played_once_and_the_mean_is_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    playing = _made()
    assert playing.finish() == 0
    assert playing.played == [4, 5, 6]
    printed = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["5", "1.000", "2"] in printed
    assert ["mean", "1.000"] in printed


@pytest.mark.parametrize(
    ("failure", "status", "said"),
    [
        (KeyboardInterrupt(), INTERRUPTED, "limberjack: interrupted: 1 of 3 episodes finished"),
        (PolicyError("no action"), FAILED, "limberjack: no action; 1 of 3 episodes finished"),
    ],
)
def test_episodes_that_finished_before_an_error_are_kept(
    failure: BaseException, status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    playing = _made()
    playing.failure = failure
    assert playing.finish() == status
    assert capsys.readouterr().err.splitlines() == [said]


def test_an_error_of_a_users_code_is_one_line_after_the_files_are_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    playing = _made(out=tmp_path)
    playing.failure = ZeroDivisionError("bug")  # raised in this file, which is not the package's
    assert playing.finish() == FAILED
    assert "ZeroDivisionError: bug" in capsys.readouterr().err
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert [episode["seed"] for episode in result["episodes"]] == [4]
    assert result["episodes_asked_for"] == 3
    assert result["time_limit"] == 25.0  # the task's own


def test_the_time_limit_of_the_command_line_is_that_of_the_result(tmp_path: Path) -> None:
    assert _made(time_limit=0.1, out=tmp_path).finish() == 0
    assert json.loads((tmp_path / "result.json").read_text())["time_limit"] == 0.1


def test_episodes_without_an_end_are_refused_before_any_is_played(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--time-limit is inf"):
        _made(range(1), float("inf"), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
