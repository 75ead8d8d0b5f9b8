"""A registered domain whose task is not made of `suite.base.Task`, in every command."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.testing

from limberjack import bench, suite
from limberjack.cli import app
from tests import plain_domain


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(suite._DOMAINS, "plain", plain_domain)


def _invoke(*arguments: object) -> Any:
    return typer.testing.CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_run_plays_and_reports_it(tmp_path: Path) -> None:
    result = _invoke(
        "run", "plain", "push", "--policy", "random", "--episodes", 3, "--out", tmp_path
    )
    assert result.exit_code == 0, result.output
    found = json.loads((tmp_path / "result.json").read_text())
    assert [set(episode) for episode in found["episodes"]] == [{"seed", "return", "length"}] * 3
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "place, one number" in page
    assert "Reward and its terms" in page


def test_evaluate_and_bench_measure_it(tmp_path: Path) -> None:
    seeds = ["--seeds", "0:3", "--threads", 1]
    result = _invoke("evaluate", "plain", "push", *seeds, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "returns.png").exists()
    result = _invoke("bench", "plain", "push", "--num-envs", 2, "--threads", 1, "--seconds", 0.01)
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (
            ["run"],
            r"plain drift has no time limit, .*: give it a time_limit \(--time-limit SECONDS\)",
        ),
        (
            ["evaluate"],
            "plain drift has no time limit, so an episode might never end: give it a time",
        ),
        (["record", "--out", "film.mp4"], "would never end: give its seconds"),
        (["solve"], "the planner knows no cost for tasks of type Push|has no time limit"),
    ],
)
def test_a_task_without_a_time_limit_is_status_2_in_one_line(
    command: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = _invoke(command[0], "plain", "drift", *command[1:])
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert re.search(message, result.stderr), result.stderr
    assert not list(tmp_path.iterdir())


def test_a_task_without_a_time_limit_runs_for_the_one_that_is_given() -> None:
    result = _invoke("run", "plain", "drift", "--time-limit", 0.1)
    assert result.exit_code == 0, result.output
    result = _invoke("evaluate", "plain", "drift", "--time-limit", 0.1, "--episodes", 2)
    assert result.exit_code == 0, result.output


def test_episodes_that_are_too_short_to_measure_are_refused() -> None:
    def short(seed: int) -> Any:
        return plain_domain.push(0.1, seed)

    with pytest.raises(ValueError, match="has episodes of 5 steps; expected at least 16"):
        bench.measure(short, num_envs=2, num_threads=[1], seconds=0.01)


def test_a_bench_of_a_function_says_which_it_was() -> None:
    result = bench.measure(plain_domain.make, num_envs=2, num_threads=[1], seconds=0.01)
    assert result.facts["environment"] == "tests.plain_domain:make"
    assert result.facts["environment_sha256"] is not None


def test_a_batch_of_one_row_can_be_measured() -> None:
    result = bench.measure("stacker", "stack_2", num_envs=1, num_threads=[1], seconds=0.01)
    assert result.facts == {"domain": "stacker", "task": "stack_2"}
    assert all(speed.steps_per_second > 0 for speed in result.speeds)


def test_episodes_that_the_task_ends_early_can_be_measured() -> None:
    def falling(seed: int) -> Any:
        environment = plain_domain.make(seed)
        environment._task = _Ending(seed)
        return environment

    result = bench.measure(falling, num_envs=8, num_threads=[1], seconds=0.01)
    assert result.recommended_threads == {"step": 1, "inference": 1}


class _Ending(plain_domain.Push):
    """Ends the episodes of carts that are far to the right."""

    def get_termination(self, physics: Any) -> Any:
        far = physics.data.qpos[..., 0] > 0.5
        if physics.num_envs is None:
            return 0.0 if far else None
        return np.where(far, 0.0, np.nan)
