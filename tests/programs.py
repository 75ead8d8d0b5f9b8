"""Runs programs in separate Python processes, to isolate their effects from the tests' process."""

import json
import os
import socket
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import limberjack

__all__ = [
    "INSTALL",
    "LIMIT",
    "environment",
    "report_without_places",
    "run",
    "run_benchmark",
]

_SOURCE = Path(limberjack.__file__).parents[1]
_BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
# Seconds; a program that hangs fails, on the slowest machine too.
LIMIT, _LIMIT_OF_BENCHMARKS = 300, 600

INSTALL = "import limberjack; limberjack.install_as_dm_control()"


def run(
    program: str,
    *arguments: str,
    path: Path | None = None,
    warnings: str = "error",
    python: Path | str = sys.executable,
) -> str:
    """The program's output; fails unless it exits with status 0 and an empty standard error.

    `path` is put first on the module search path; `warnings` is the warning filter; `python` is the
    interpreter.
    """
    done = subprocess.run(
        [python, "-W", warnings, "-c", textwrap.dedent(program), *arguments],
        capture_output=True,
        text=True,
        env=environment(path),
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def run_benchmark(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The result of running a script of benchmarks/."""
    return subprocess.run(
        [sys.executable, str(_BENCHMARKS / script), *arguments],
        capture_output=True,
        text=True,
        env=environment(),
        timeout=_LIMIT_OF_BENCHMARKS,
        check=False,
    )


def report_without_places(text: str) -> dict[str, Any]:
    """A benchmark's report from its JSON; fails if it names no versions and machine, or names the
    host or a path of this machine.
    """
    report = json.loads(text)
    assert report["versions"]["limberjack"] == limberjack.__version__
    assert {"python", "numpy"} < report["versions"].keys()
    assert report["machine"]["cores"] >= 1
    assert f'"{socket.gethostname()}"' not in text
    for place in (Path.home(), _SOURCE, sys.prefix):
        assert str(place) not in text
    return report


def environment(first: Path | None = None) -> dict[str, str]:
    """This process's environment variables, with the package on the module search path."""
    places = [str(place) for place in (first, _SOURCE) if place is not None]
    known = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": os.pathsep.join(places + ([known] if known else []))}
