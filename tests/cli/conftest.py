"""The command called in this process and as a program, and policies that fail on request."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer.testing

from limberjack.cli import app
from tests.plain_pictures import draw_without_shadows

# Ends or fails in the episode and at the step that the environment variable names.
POLICY = """
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


def invoke(*arguments: str) -> Any:
    """The result of the command in this process, without a terminal."""
    return typer.testing.CliRunner().invoke(app, list(arguments))


def call(
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
    (tmp_path / "my_policies.py").write_text(POLICY)
    return tmp_path


def leave_out_films(patch: pytest.MonkeyPatch) -> None:
    """Makes films, which take longer than short episodes, lack their packages."""

    def missing(*arguments: object) -> None:
        raise ImportError("no film in this test")

    patch.setattr("limberjack.see.report.recorder.Film", missing)


@pytest.fixture
def no_films(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves out the films of one test."""
    leave_out_films(monkeypatch)


@pytest.fixture
def invoke_there(directory: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """`invoke` in the working directory with the module of policies, which is read again."""
    monkeypatch.chdir(directory)

    def invoked(*arguments: str, **variables: str) -> Any:
        monkeypatch.delitem(sys.modules, "my_policies", raising=False)
        for name, value in variables.items():
            monkeypatch.setenv(name, value)
        return invoke(*arguments)

    return invoked


@pytest.fixture(autouse=True)
def _search_path() -> Iterator[None]:
    """The command adds the working directory to the module search path: that is undone."""
    before = list(sys.path)
    yield
    sys.path[:] = before


@pytest.fixture(autouse=True)
def _no_shadows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Films are of the tasks; shadows are tested with the renderer."""
    draw_without_shadows(monkeypatch)
