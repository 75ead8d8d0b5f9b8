"""Calling a function in a Python of its own, for what the present process would spoil.

    seconds = fresh.call("imports", "seconds_to_import", "limberjack")

The function is one of a module beside this file. Arguments and result are plain values: numbers,
texts, and lists, tuples and dicts of them.
"""

import ast
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["call"]

_HERE = str(Path(__file__).resolve().parent)


def call(
    module: str, function: str, *arguments: Any, variables: Mapping[str, str | None] | None = None
) -> Any:
    """What the function returns in a fresh process.

    Args:
      module: one beside this file. It should import nothing that the function is to be free of.
      function: its name.
      *arguments: passed to it.
      variables: environment variables to set there, or to remove where the value is None.
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
