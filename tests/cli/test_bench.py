"""`limberjack bench`."""

import re

from tests.cli.conftest import invoke

_FEW = ["--num-envs", "4", "--threads", "2", "--seconds", "0.01"]


def test_the_table_names_the_contestants_and_their_reference() -> None:
    done = invoke("bench", "stacker/stack_2", *_FEW)
    assert done.exit_code == 0, done.output
    lines = [line.strip() for line in done.stdout.splitlines() if line.strip()]
    assert lines[0].startswith("stacker stack_2: 4 environments, random actions. A step is one")
    assert re.split("  +", lines[1]) == ["stepped", "threads", "steps/s", "speed", "relative to"]
    rows = [re.split("  +", line) for line in lines[3:8]]
    alone, vector = "MuJoCo alone (mujoco.batch)", "Gymnasium VectorEnv (flat, float32)"
    assert [(row[0], row[1]) for row in rows] == [
        (alone, "2"),
        ("BatchEnvironment", "2"),
        (vector, "2"),
        (vector, "1"),
        (vector, "2"),
    ]
    references = ["MuJoCo alone, same steps"] * 3 + ["the same with 1 thread"] * 2
    assert [row[-1] for row in rows] == references
    assert [rows[i][3] for i in (0, 3)] == ["1.00 x", "1.00 x"]
    recommended = r"Recommended: num_threads=[12] for 4 environments, the fewest that reach 95%"
    assert re.match(recommended, lines[-1])


def test_more_environments_than_fit_are_one_line_and_status_2() -> None:
    result = invoke("bench", "pendulum", "swingup", "--num-envs", "1000000000")
    assert result.exit_code == 2
    assert result.stderr.startswith("limberjack: num_envs is 1000000000, which takes ")
    assert result.stderr.count("\n") == 1


def test_an_unknown_task_is_status_2_with_a_suggestion() -> None:
    done = invoke("bench", "stacker", "stak_2")
    assert done.exit_code == 2
    assert "Did you mean 'stack_2'?" in done.stderr


def test_a_device_that_cannot_be_used_is_one_line_that_says_what_to_install() -> None:
    done = invoke("bench", "cartpole", "balance", "--device", "cuda:99")
    assert done.exit_code == 2
    assert len(done.stderr.splitlines()) == 1
    assert "pip install mujoco-warp torch warp-lang" in done.stderr or "'cuda:99'" in done.stderr
