"""`limberjack bench`."""

import re
import sys

import pytest

from tests.cli.conftest import invoke

_FEW = ["--num-envs", "4", "--threads", "1,2", "--seconds", "0.01"]


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of few rows are as long as an episode has steps for all rounds: six steps of 60."""
    monkeypatch.setattr("limberjack.bench.contest._EPISODE", 60)


def test_the_tables_name_the_contestants_and_their_reference() -> None:
    done = invoke("bench", "stacker/stack_2", *_FEW, "--columns", "inference, step")
    assert done.exit_code == 0, done.output
    lines = [line.strip() for line in done.stdout.splitlines() if line.strip()]
    assert lines[0].startswith("stacker stack_2: 4 environments, random actions. A step is one")
    assert re.split("  +", lines[1]) == ["stepped", "threads", "steps/s", "speed", "relative to"]
    rows = [re.split("  +", line) for line in lines[3:6]]
    alone, vector = "MuJoCo alone (mujoco.batch)", "Gymnasium VectorEnv (flat, float32)"
    assert [row[0] for row in rows] == [alone, "BatchEnvironment", vector]
    assert [row[1] for row in rows] == ["2"] * 3
    assert [row[-1] for row in rows] == ["MuJoCo alone, same steps"] * 3
    assert rows[0][3] == "1.00 x"
    assert lines[6] == "Steps/s by number of threads:"
    columns = ["threads", "step", "inference", "p95 of a step", "memory"]
    assert re.split("  +", lines[7]) == columns
    ours = [re.split("  +", line) for line in lines[9:] if line.startswith("Limberjack")]
    assert [row[1] for row in ours] == ["1", "2"]
    assert all(re.fullmatch(r"[\d.]+ ms", row[4]) for row in ours)
    recommended = (
        r"Recommended: num_threads=([12]|[12] \(step\), [12] \(inference\)) for 4 environments, "
        "the fewest that reach 95% of the highest speed"
    )
    assert re.fullmatch(recommended, lines[-1])


def test_a_column_without_its_packages_is_one_line_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "limberjack.training.learner", None)
    done = invoke("bench", "stacker/stack_2", *_FEW, "--columns", "step,training")
    assert done.exit_code == 0, done.output
    (line,) = done.stderr.splitlines()
    assert line.startswith("limberjack: training is not measured: ")
    assert "Limberjack  " in done.stdout


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--threads", "two", "--threads is 'two'; expected numbers, such as 1,2,4"),
        ("--threads", "8", "num_threads is [8]; expected numbers from 1 to 4"),
        ("--columns", "stp", "there is no column 'stp'; expected some of step, inference, trai"),
    ],
)
def test_an_option_that_cannot_be_measured_is_one_line_and_status_2(
    option: str, value: str, message: str
) -> None:
    done = invoke("bench", "stacker/stack_2", "--num-envs", "4", option, value)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"limberjack: {message}")
    assert done.stderr.count("\n") == 1


def test_more_environments_than_fit_are_one_line_and_status_2() -> None:
    result = invoke("bench", "pendulum", "swingup", "--num-envs", "1000000000")
    assert result.exit_code == 2
    assert result.stderr.startswith("limberjack: num_envs is 1000000000, which takes ")
    assert result.stderr.count("\n") == 1


def test_an_unknown_task_is_status_2_with_a_suggestion() -> None:
    done = invoke("bench", "stacker", "stak_2")
    assert done.exit_code == 2
    assert "Did you mean 'stack_2'?" in done.stderr


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--threads", "1,2"], "--threads"),
        (["--columns", "step", "--threads", "1"], "--threads and --columns"),
    ],
)
def test_what_a_device_does_not_have_is_refused_beside_it(options: list[str], named: str) -> None:
    done = invoke("bench", "cartpole", "balance", "--device", "cuda:0", *options)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"limberjack: got {named} beside --device cuda:0, which measures")
    assert done.stderr.count("\n") == 1


def test_a_device_that_cannot_be_used_is_one_line_that_says_what_to_install() -> None:
    done = invoke("bench", "cartpole", "balance", "--device", "cuda:99")
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert "pip install mujoco-warp torch warp-lang" in done.stderr or "'cuda:99'" in done.stderr
