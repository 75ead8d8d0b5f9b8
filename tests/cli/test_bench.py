"""`limberjack bench`."""

import re

import typer.testing

from limberjack.cli import app


def test_the_command_prints_speeds_and_a_recommendation() -> None:
    arguments = ["bench", "stacker", "stack_2", "--num-envs", "4", "--threads", "2"]
    done = typer.testing.CliRunner().invoke(app, [*arguments, "--seconds", "0.01"])
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    first_words = [line.split()[0] for line in lines if line.strip()]
    assert first_words[0] == "what"
    assert first_words[2:5] == ["physics", "batch", "vector"]
    assert re.search(r"^Recommended for 4 rows: num_threads=[12]$", lines[-1])


def test_the_command_refuses_what_cannot_be_measured() -> None:
    done = typer.testing.CliRunner().invoke(app, ["bench", "stacker", "stak_2"])
    assert done.exit_code == 2
    assert "Did you mean 'stack_2'?" in done.stderr
