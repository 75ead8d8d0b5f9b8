"""A fixture: scripts in separate processes."""

import os
import subprocess
import sys
from collections.abc import Callable

import pytest

_LONGEST = 120  # seconds; scripts take far less, so a longer one hangs


@pytest.fixture
def run_script() -> Callable[..., str]:
    """Runs a script in a new process, with environment variables; returns what it printed.

    It fails unless the process exits with status 0 and an empty standard error. Warnings are errors
    there, except for Python's warning about forking a process with threads. None unsets a variable.
    `longest`, in seconds, is for scripts that take more than two minutes.
    """

    def run(script: str, longest: float = _LONGEST, **variables: str | None) -> str:
        backend = "egl" if sys.platform == "linux" else None
        # dm_control sets the second for PyOpenGL, in this process.
        changes = {"MUJOCO_GL": backend, "PYOPENGL_PLATFORM": None} | variables
        environment = {k: v for k, v in os.environ.items() if k not in changes}
        environment |= {k: v for k, v in changes.items() if v is not None}
        flags = ["-W", "error", "-W", "ignore:This process:DeprecationWarning"]
        done = subprocess.run(
            [sys.executable, *flags, "-c", script],
            env=environment,
            capture_output=True,
            text=True,
            timeout=longest,
            check=False,
        )
        assert (done.returncode, done.stderr) == (0, ""), done.stdout
        return done.stdout

    return run
