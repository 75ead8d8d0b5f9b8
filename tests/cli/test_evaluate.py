"""`limberjack evaluate`."""

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.testing

from limberjack.cli import app

_COMMAND = ["evaluate", "stacker", "stack_2", "--threads", "1", "--time-limit", "0.1"]
_STAND = ["evaluate", "humanoid", "stand", "--threads", "1", "--time-limit", "0.1"]

# Interrupts the process in the step that plays the seed.
_INTERRUPTING = """
import os, signal
import numpy as np

class Interrupting:
    def reset_batch(self, rows, seeds):
        if 70 in seeds:
            os.kill(os.getpid(), signal.SIGINT)

    def act_batch(self, observations):
        return np.zeros((64, 21))
"""


def _invoke(*arguments: str) -> Any:
    return typer.testing.CliRunner().invoke(app, list(arguments))


@pytest.fixture(autouse=True)
def _search_path() -> Iterator[None]:
    """The command adds the working directory to the module search path: that is undone."""
    before = list(sys.path)
    yield
    sys.path[:] = before


def test_the_table_has_the_policy_and_the_floors_by_start(tmp_path: Path) -> None:
    result = _invoke(*_COMMAND, "--policy", "random", "--seeds", "3:13", "--out", str(tmp_path))
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "result.json").read_text())["summary"]
    for policy in ("random", "zero"):
        mean, (low, high) = summary[policy]["mean"], summary[policy]["interval"]
        row = rf"^ {policy} +10 +{mean:.1f} +{low:.1f} to {high:.1f} +\d+\.\d +0\.0 % *$"
        assert re.search(row, result.stdout, re.MULTILINE), result.stdout
    assert result.stdout.count("level_0") == 2
    assert "success: a mean reward of at least 0.9 over the last 100 steps" in result.stdout
    names = ("result.json", "report.html", "returns.png")
    assert result.stdout.splitlines()[-3:] == [str(tmp_path / name) for name in names]
    assert "<dt>Command</dt>" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert result.stderr == ""


def test_episodes_takes_the_first_seeds() -> None:
    result = _invoke(*_COMMAND, "--seeds", "3:13", "--episodes", "4")
    assert result.exit_code == 0, result.output
    assert re.search(r"^ zero +4 ", result.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], range(100)),
        (["--episodes", "200"], range(200)),
        (["--seeds", "3:13"], range(3, 13)),
        (["--seeds", "3:13", "--episodes", "4"], range(3, 7)),
    ],
)
def test_seeds_may_be_given_by_their_range_their_number_or_both(
    arguments: list[str], expected: range, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[range] = []

    def evaluate(domain: str, task: str, policy: str, seeds: range, **kwargs: object) -> None:
        asked.append(seeds)
        raise ValueError("that will do")

    monkeypatch.setattr("limberjack.evaluation.evaluate", evaluate)
    result = _invoke(*_COMMAND, *arguments)
    assert result.stderr == "limberjack: that will do\n"
    assert asked == [expected]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seeds", "five"], "--seeds is 'five'; expected A:B, such as 0:100"),
        (["--seeds", "-1:5"], "--seeds is '-1:5'; expected A:B"),
        (["--seeds", "5:5"], "--seeds is 5:5, which holds no seed; expected A:B with A below B"),
        (["--seeds", "0:4294967297"], "expected numbers up to 4294967295"),
        (
            ["--episodes", "101", "--seeds", "0:100"],
            "--episodes is 101, but --seeds 0:100 holds 100: give more seeds",
        ),
        (["--policy", "radnom"], "Did you mean 'random'?"),
        (["--policy", "nowhere:act"], "there is no module 'nowhere'"),
        (["--time-limit", "0"], "time_limit is 0.0; expected a positive number"),
        (["--out", "a_file"], "a_file"),
    ],
)
def test_a_mistake_is_one_line_and_status_2(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a_file").write_text("")
    monkeypatch.chdir(tmp_path)
    result = _invoke(*_COMMAND, *arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr.startswith("limberjack: ")
    assert message in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.parametrize("arguments", [["--episodes", "0"], ["--threads", "0"]])
def test_no_episodes_and_no_threads_are_status_2(arguments: list[str]) -> None:
    assert _invoke(*_COMMAND, *arguments).exit_code == 2


def test_a_folder_with_other_results_is_status_2(tmp_path: Path) -> None:
    few = ["--seeds", "0:2", "--out", str(tmp_path)]
    assert _invoke(*_COMMAND, *few).exit_code == 0
    result = _invoke(*_STAND, *few)
    assert result.exit_code == 2
    assert "holds an evaluation with domain 'stacker', and this one has 'humanoid'" in result.stderr


def test_a_policy_that_fails_is_status_1_and_finished_episodes_are_kept(tmp_path: Path) -> None:
    policy = ["--policy", "evaluated:NotANumber", "--seeds", "0:100", "--out", str(tmp_path)]
    result = _invoke(*_STAND, *policy)
    assert result.exit_code == 1
    assert result.stderr == (
        "limberjack: policy 'evaluated:NotANumber', step 3 of the episode with seed 70: returned "
        "nan at index [2]; expected finite numbers; 64 of 300 episodes finished, and are kept in "
        f"{tmp_path}: the same command continues from there\n"
    )


def test_a_policy_that_fails_in_its_first_step_is_status_1_too(tmp_path: Path) -> None:
    kept = ["--seeds", "0:2", "--out", str(tmp_path), "--policy"]
    assert _invoke(*_STAND, *kept, "evaluated:too_long").exit_code == 1
    result = _invoke(*_STAND, *kept, "evaluated:TooShort")
    assert result.exit_code == 1
    assert "; 0 of 6 episodes finished, and are kept in" in result.stderr


@pytest.mark.parametrize("name", ["raising", "Raising"])
def test_an_error_of_a_policy_is_the_sentence_that_workers_give(name: str) -> None:
    command = (*_STAND, "--policy", f"evaluated:{name}", "--seeds", "5:7")
    result = _invoke(*command)
    assert result.exit_code == 1
    place = r"\((.*/)?tests/evaluation/evaluated\.py, line \d+, in \w+\)"
    assert re.fullmatch(
        f"limberjack: policy 'evaluated:{name}', step 0 of the episode with seed 5: ValueError: "
        f"[^(]*{place}; 0 of 6 episodes finished; with --out they would have been kept\n",
        result.stderr,
    )
    of_workers = _invoke(*command, "--workers", "1").stderr
    assert of_workers.replace(f"; on node {socket.gethostname()}", "") == result.stderr


def test_an_error_of_a_policys_module_is_one_line_and_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "unfinished.py").write_text("act = undefined\n")
    monkeypatch.syspath_prepend(tmp_path)
    result = _invoke(*_STAND, "--policy", "unfinished:act")
    assert result.exit_code == 2
    assert result.stderr.startswith(
        "limberjack: policy 'unfinished:act', as its module is imported: NameError: name "
        "'undefined' is not defined ("
    )
    assert result.stderr.endswith("unfinished.py, line 1, in <module>)\n")


def test_an_interrupt_is_status_130_and_says_how_to_continue(tmp_path: Path) -> None:
    (tmp_path / "interrupting.py").write_text(_INTERRUPTING)
    policy = ["--policy", "interrupting:Interrupting", "--seeds", "0:100", "--out", "out"]
    done = subprocess.run(
        [sys.executable, "-m", "limberjack", *_STAND, *policy],
        cwd=tmp_path,
        env={name: value for name, value in os.environ.items() if "COLOR" not in name},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 130
    assert done.stderr == (
        "limberjack: interrupted: 64 of 300 episodes finished, and are kept in out: the same "
        "command continues from there\n"
    )


def test_without_the_extra_a_saved_model_is_one_line_that_names_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "limberjack.sb3", raising=False)
    result = _invoke(*_COMMAND, "--policy", "sb3:model.zip")
    assert result.exit_code == 2
    assert "needs the extra 'sb3': pip install sb3-contrib stable-baselines3" in result.stderr


def test_shards_are_reported_and_joined_by_the_same_command(tmp_path: Path) -> None:
    few = ["--seeds", "60:70", "--out", str(tmp_path)]
    for shard in ("1/3", "2/3", "3/3"):
        result = _invoke(*_COMMAND, *few, "--shard", shard)
        assert result.exit_code == 0, result.output
    assert result.stdout == (
        f"shard 3/3: 12 episodes are kept in {tmp_path}; the same command without --shard joins "
        "all shards\n"
    )
    joined = _invoke(*_COMMAND, *few)
    assert re.search(r"^ zero +10 ", joined.stdout, re.MULTILINE)
    run = _invoke("run", *_COMMAND[1:3], "--time-limit", "0.1", "--out", str(tmp_path))
    assert (run.exit_code, "holds an evaluation" in run.stderr) == (2, True)


def test_a_policy_that_fails_in_a_worker_is_one_line_and_status_1(tmp_path: Path) -> None:
    few = ["--seeds", "0:2", "--out", str(tmp_path), "--workers", "1"]
    result = _invoke(*_STAND, "--policy", "evaluated:Raising", *few)
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith(
        "limberjack: policy 'evaluated:Raising', step 0 of the episode with seed 0: ValueError: a "
        "mistake of the policy's own ("
    )
    assert ", in raising); on node " in result.stderr
    assert result.stderr.endswith(
        f"; 0 of 6 episodes finished, and are kept in {tmp_path}: the same command continues from "
        "there\n"
    )


def test_a_shard_without_a_folder_is_status_2() -> None:
    result = _invoke(*_COMMAND, "--shard", "1/3", "--policy", "zero")
    assert result.exit_code == 2
    assert "--shard 1/3 needs --out DIR" in result.stderr


# A set of tasks.


@pytest.fixture
def small_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two tasks and two seeds in the place of dmc-sparse and its ten."""
    from limberjack.evaluation import protocol
    from limberjack.registry import sets

    tasks = (("cartpole", "balance_sparse"), ("pendulum", "swingup"))
    small = sets.TaskSet("dmc-sparse", tasks, "this test")
    monkeypatch.setattr(sets, "_SETS_OF_PAPERS", (small,))
    monkeypatch.setattr(protocol, "_SEEDS", range(30_000, 30_002))


@pytest.mark.usefixtures("small_set")
def test_a_set_has_a_row_for_each_task_and_the_aggregate_score(tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ["evaluate", "--set", "dmc-sparse", "--policy", "zero", "--policy", "random"]
    result = _invoke(*command, "--threads", "1", "--out", str(out))
    assert result.exit_code == 0, result.output
    made = json.loads((out / "set.json").read_text(encoding="utf-8"))
    for task in made["tasks"]:
        low, high = sorted(task["returns"])
        mean = sum(task["returns"]) / 2
        zero, random = task["floors"]["zero"], task["floors"]["random"]
        row = (
            rf"^ {task['domain']} {task['task']} +{mean:.1f} +{low:.1f} +{high:.1f} "
            rf"+{mean / 1000:.3f} +{zero:.1f} +{random:.1f} +2 +500 *$"
        )
        assert re.search(row, result.stdout, re.MULTILINE), result.stdout
    summary = made["summary"]
    assert (
        "2 of 2 tasks of dmc-sparse, 2 runs: interquartile mean of the scores "
        "{:.3f} ({:.3f} to {:.3f})".format(summary["interquartile_mean"], *summary["interval"])
    ) in result.stdout
    assert f"50 %: {summary['percentiles']['50']:.3f}" in result.stdout
    assert result.stdout.splitlines()[-1] == str(out / "set.json")
    assert result.stderr == ""
    again = _invoke(*command, "--threads", "1", "--out", str(out))
    assert again.stdout == result.stdout


@pytest.mark.usefixtures("small_set")
def test_a_mistake_in_the_second_task_of_a_set_is_one_line_that_names_it(tmp_path: Path) -> None:
    folder = tmp_path / "run-1" / "pendulum-swingup"
    command = ["evaluate", "--set", "dmc-sparse", "--threads", "1", "--out", str(tmp_path)]
    assert _invoke(*command).exit_code == 0
    for task in ("cartpole-balance_sparse", "pendulum-swingup"):
        for path in (tmp_path / "run-1" / task).iterdir():
            path.unlink()
    (folder / "episodes.jsonl").write_text("mine\n")
    result = _invoke(*command)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"limberjack: pendulum swingup: {folder}/episodes.jsonl does ")
    assert "; 4 of 8 episodes finished, and are kept in " in result.stderr
    assert result.stderr.count("\n") == 1
    (tmp_path / "set.json").write_text("[" * 100_000)
    result = _invoke(*command)
    assert result.exit_code == 2
    assert "set.json is no result of this command" in result.stderr


@pytest.mark.usefixtures("small_set")
def test_tasks_that_lack_a_policy_are_printed_as_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    still = "def act(observation):\n    return [0.0]\n"
    (tmp_path / "of_swingup.py").write_text(still, encoding="utf-8")
    command = ["evaluate", "--set", "dmc-sparse", "--policy", "of_{task}:act", "--threads", "1"]
    try:
        result = _invoke(*command)
    finally:
        sys.modules.pop("of_swingup", None)
    assert result.exit_code == 0, result.output
    assert "missing: cartpole balance_sparse: policy 'of_balance_sparse:act': " in result.stdout
    assert "1 of 2 tasks of dmc-sparse, 1 run: interquartile mean" in result.stdout
    assert "percentiles" not in result.stdout
    assert result.stdout.splitlines()[-1] == "score: return / 1000"  # one run has no interval


@pytest.mark.usefixtures("small_set")
def test_one_line_says_that_saved_models_of_a_set_are_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("stable_baselines3", reason="needs the extra 'sb3'")
    monkeypatch.chdir(tmp_path)
    for name in ("cartpole-balance_sparse", "pendulum-swingup"):
        (tmp_path / f"{name}.zip").write_bytes(b"no model")
    command = ["evaluate", "--set", "dmc-sparse", "--policy", "sb3:{domain}-{task}.zip"]
    result = _invoke(*command)
    assert result.exit_code == 2
    said, why = result.stderr.splitlines()
    assert said.startswith("limberjack: policy 'sb3:cartpole-balance_sparse.zip' is a pickle")
    assert "no task has a policy of every run; cartpole balance_sparse: policy 'sb3:cart" in why


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "dmc29"], "no set of tasks 'dmc29'; expected one of dmc28"),
        (["walker", "--set", "dmc28"], "got DOMAIN beside --set, which fixes them"),
        (["--set", "dmc28", "--seeds", "0:4", "--action-repeat", "4"], "--seeds and --action-rep"),
        (["--set", "dmc28", "--policy", "radnom"], "Did you mean 'random'?"),
        (["walker", "walk", "--policy", "zero", "--policy", "random"], "got 2 policies; expected"),
    ],
)
def test_a_mistake_with_a_set_is_one_line_and_status_2(arguments: list[str], message: str) -> None:
    result = _invoke("evaluate", *arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert message in result.stderr
    assert result.stderr.count("\n") == 1
