"""Calls a function in a fresh Python process, for measurements that this process would distort.

    seconds = fresh.call("imports", "seconds_to_import", "limberjack")

The function is defined in a module in this folder. Arguments and results are plain values: numbers,
texts, and lists, tuples and dicts of them.
"""

import ast
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["call", "python_of"]

_HERE = str(Path(__file__).resolve().parent)


def call(
    module: str, function: str, *arguments: Any, variables: Mapping[str, str | None] | None = None
) -> Any:
    """The function's result in a fresh process.

    Args:
      module: a module in this folder, which must not import anything that affects the measurement.
      function: the function's name.
      *arguments: the function's arguments.
      variables: environment variables to set in the process; None removes a variable.
    """
    known = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([_HERE, known] if known else [_HERE])
    environment = {**os.environ, "PYTHONPATH": path, **(variables or {})}
    program = f"import {module}; print(repr({module}.{function}(*{arguments!r})))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        env={name: value for name, value in environment.items() if value is not None},
        check=True,
    )
    return ast.literal_eval(done.stdout)


def python_of(folder: Path) -> Path:
    """The interpreter of a virtual environment."""
    windows = folder / "Scripts" / "python.exe"
    return windows if windows.exists() else folder / "bin" / "python"
