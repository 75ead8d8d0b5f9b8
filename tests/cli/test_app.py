"""The command itself: version, help, and what every command refuses."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.testing

import limberjack
from limberjack.cli import app

_RUN = ["run", "humanoid", "stand", "--time-limit", "0.25"]


# Ends or fails in the episode and at the step that the environment variable names.
_POLICY = """
import os, signal
import numpy as np
from limberjack.rl.control import PhysicsError

class Scripted:
    def __init__(self):
        self.episode = -1
        self.at = int(os.environ.get("EPISODE", "1"))

    def reset(self):
        self.episode += 1
        self.step = 0

    def act(self, observation):
        self.step += 1
        now = self.episode == self.at and self.step == 5
        return self.happen() if now else np.zeros(21)

class Interrupted(Scripted):
    def happen(self):
        os.kill(os.getpid(), signal.SIGINT)
        return np.zeros(21)

class NotANumber(Scripted):
    def happen(self):
        return np.full(21, np.nan)

class Diverging(Scripted):
    def happen(self):
        raise PhysicsError("the simulation diverged")

class Broken(Scripted):
    def happen(self):
        return {}["no such key"]

def still(observation):
    return np.zeros(21)
"""


def _invoke(*arguments: str) -> Any:
    """The result of the command in this process, without a terminal."""
    return typer.testing.CliRunner().invoke(app, list(arguments))


def _call(
    *arguments: str, directory: Path | None = None, **variables: str
) -> "subprocess.CompletedProcess[str]":
    """The result of the command as a program, without a terminal."""
    # Without what CI services set to have colours in their logs.
    inherited = {name: value for name, value in os.environ.items() if "COLOR" not in name}
    return subprocess.run(
        [sys.executable, "-m", "limberjack", *arguments],
        cwd=directory,
        env=inherited | variables,
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """A working directory with a module of policies."""
    (tmp_path / "my_policies.py").write_text(_POLICY)
    return tmp_path


@pytest.fixture(autouse=True)
def _search_path() -> Iterator[None]:
    """The command adds the working directory to the module search path: that is undone."""
    before = list(sys.path)
    yield
    sys.path[:] = before


def test_the_installed_command_is_the_same(tmp_path: Path) -> None:
    command = Path(sys.executable).with_name("limberjack")
    if not command.exists():
        pytest.skip("limberjack is not installed beside this Python; it is run from its source")
    result = subprocess.run(
        [command, *_RUN], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert result.stdout == _call(*_RUN, directory=tmp_path).stdout


def test_version_and_help() -> None:
    assert _invoke("--version").stdout.strip() == limberjack.__version__
    assert "Run episodes of a task" in _invoke("run", "--help").stdout


@pytest.mark.parametrize(
    "arguments",
    [
        ["run"],
        ["run", "humanoid"],
        [*_RUN, "--episodes", "0"],
        [*_RUN, "--seed", "-1"],
        [*_RUN, "--seed", "4294967296"],
        [*_RUN, "--speed", "3"],
        ["ru"],
    ],
)
def test_what_cannot_be_parsed_is_status_2(arguments: list[str]) -> None:
    result = _invoke(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys; from limberjack.cli import app; app(['--help'], standalone_mode=False)\n"
        "heavy = {'mujoco', 'dm_env', 'matplotlib', 'imageio_ffmpeg'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, timeout=120)
