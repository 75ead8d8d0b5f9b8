"""Runs a probe in a process of its own, so that a crash or a hang there does not stop this one.

answer = ask("drawing", {"MUJOCO_GL": "egl"})
print(answer.value if answer.why is None else answer.why)
"""

import contextlib
import dataclasses
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from typing import Any, BinaryIO

__all__ = ["Answer", "ask"]

_LIMIT = 60.0  # seconds; a probe takes one or two, and longer on a busy machine
_KILLING = 2.0  # seconds; a process that waits in a driver may survive a kill for a while
_LONGEST_REASON = 300  # characters

# The module search path is passed on: it may have changed since this process started.
_PROGRAM = """
import sys
sys.path[:] = {path!r}
from limberjack.doctor import probes
probes.answer({probe!r}, {file!r})
"""


@dataclasses.dataclass(frozen=True)
class Answer:
    """The value that a probe returned, or the reason why it returned none."""

    value: Any = None  # of any JSON type
    why: str | None = None


def ask(probe: str, variables: Mapping[str, str] | None = None, limit: float = _LIMIT) -> Answer:
    """The answer of a function of `probes`, called in a new process.

    Args:
      probe: the function's name.
      variables: environment variables, in addition to those of this process.
      limit: the longest time that the probe may take, in seconds.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as directory:
        file = os.path.join(directory, "answer.json")
        program = _PROGRAM.format(path=sys.path, probe=probe, file=file)
        # A file: reading a pipe would block as long as any descendant process holds it open.
        with tempfile.TemporaryFile(dir=directory) as errors:
            status = _run(program, {**os.environ, **(variables or {})}, errors, limit)
            errors.seek(0)
            complaints = errors.read().decode(errors="replace")
        with contextlib.suppress(OSError, ValueError), open(file, encoding="utf-8") as answer:
            # The answer counts even if a driver crashed the process afterwards.
            return Answer(**json.load(answer))
    if status is None:
        return Answer(why=f"no answer within {limit:.0f} s")
    return Answer(why=_reason(status, complaints))


def _run(program: str, environment: dict[str, str], errors: BinaryIO, limit: float) -> int | None:
    """The exit status of a Python program; None if it exceeded the limit."""
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=errors,
    )
    try:
        return process.wait(limit)
    except subprocess.TimeoutExpired:
        return None
    finally:
        process.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_KILLING)


def _reason(status: int, complaints: str) -> str:
    """The reason why a process ended without an answer, in one line."""
    lines = [line.strip() for line in complaints.splitlines() if line.strip()]
    last = lines[-1][:_LONGEST_REASON] if lines else ""
    if status >= 0:
        return last or f"it ended with status {status}"
    try:
        crash = f"it crashed: {signal.Signals(-status).name}"
    except ValueError:
        crash = f"it crashed: signal {-status}"
    return f"{crash} ({last})" if last else crash
