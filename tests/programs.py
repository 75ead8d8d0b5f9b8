"""Running a program in a Python of its own, for what must not happen in the tests' process."""

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import limberjack

__all__ = ["INSTALL", "run"]

_SOURCE = Path(limberjack.__file__).parents[1]
_LIMIT = 300  # seconds; a program that hangs fails, on the slowest machine too

INSTALL = "import limberjack; limberjack.install_as_dm_control()"


def run(program: str, *arguments: str, path: Path | None = None, warnings: str = "error") -> str:
    """What the program prints; fails unless it ends well and says nothing on standard error.

    `path` comes before all else that it can import; `warnings` is what becomes of warnings.
    """
    places = [str(place) for place in (path, _SOURCE) if place is not None]
    known = os.environ.get("PYTHONPATH")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(places + ([known] if known else []))}
    done = subprocess.run(
        [sys.executable, "-W", warnings, "-c", textwrap.dedent(program), *arguments],
        capture_output=True,
        text=True,
        env=environment,
        timeout=_LIMIT,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout
