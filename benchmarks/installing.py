"""Packages and megabytes of Limberjack as pip installs it, into a fresh environment.

    python benchmarks/installing.py [--json FILE]

The environment has this repository, with the versions of `constraints.txt`. Counted are what pip
has brought, without pip itself and Limberjack, and the space on the disk of all of it and of
Limberjack, compiled files included. It needs the network, or pip's cache.
"""

import json as json_format
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

import fresh
import typer
from report import Json, figure, finish

__all__ = ["main"]

_REPOSITORY = Path(__file__).parents[1]

# Runs in the environment; prints its packages, with the bytes of each.
_PROGRAM = """
import importlib.metadata, json
own = {"pip", "setuptools"}
sizes = {}
for found in importlib.metadata.distributions():
    if found.name not in own:
        paths = {found.locate_file(file).resolve() for file in found.files or ()}
        sizes[found.name] = 512 * sum(path.stat().st_blocks for path in paths if path.is_file())
print(json.dumps(sizes))
"""


def _sizes(source: str) -> dict[str, int]:
    """Bytes on the disk of each package of a fresh environment with `source`, by name."""
    with tempfile.TemporaryDirectory() as directory:
        venv.create(directory, with_pip=True)
        python = fresh.python_of(Path(directory))
        constraints = ["-c", str(_REPOSITORY / "constraints.txt")]
        install = [python, "-m", "pip", "install", "--quiet", *constraints, source]
        subprocess.run(install, check=True, stdout=sys.stderr)
        done = subprocess.run(
            [python, "-c", _PROGRAM], check=True, capture_output=True, text=True, cwd=directory
        )
    return json_format.loads(done.stdout)


def main(json: Json = None) -> None:
    """Measure what an installation brings."""
    sizes = _sizes(str(_REPOSITORY))
    others = [name for name in sizes if name != "limberjack"]
    total = sum(sizes.values()) / 1e6
    largest = dict(sorted(sizes.items(), key=lambda item: -item[1]))
    rows = [
        figure("packages", "pip install .", len(others), ""),
        figure("disk", "pip install .", total, "MB", details={"bytes": largest}),
    ]
    finish(rows, "", json=json)


if __name__ == "__main__":
    typer.run(main)
