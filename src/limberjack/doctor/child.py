"""Calling a probe in a process of its own, so that whatever happens there, this one goes on.

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

_LIMIT = 60.0  # seconds; a probe takes one or two, on a busy machine some more
_KILLING = 2.0  # seconds; a process that waits in a driver may outlast being killed
_LONGEST_REASON = 300  # characters

# Finds what this process finds: its path may have been changed since it was started.
_PROGRAM = """
import sys
sys.path[:] = {path!r}
from limberjack.doctor import probes
probes.answer({probe!r}, {file!r})
"""


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a probe returned, or why it did not."""

    value: Any = None  # Any: whatever JSON can say
    why: str | None = None


def ask(probe: str, variables: Mapping[str, str] | None = None, limit: float = _LIMIT) -> Answer:
    """What a function of `probes` returns in a new process.

    Args:
      probe: its name.
      variables: of the environment, besides those of this process.
      limit: seconds that it may take.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as directory:
        file = os.path.join(directory, "answer.json")
        program = _PROGRAM.format(path=sys.path, probe=probe, file=file)
        # A file, because a pipe would be waited for as long as any process below has it open.
        with open(os.path.join(directory, "errors"), "w+b") as errors:
            status = _run(program, {**os.environ, **(variables or {})}, errors, limit)
            errors.seek(0)
            complaints = errors.read().decode(errors="replace")
        with contextlib.suppress(OSError, ValueError), open(file, encoding="utf-8") as answer:
            # It has answered, even if a driver crashed it afterwards.
            return Answer(**json.load(answer))
    if status is None:
        return Answer(why=f"no answer within {limit:.0f} s")
    return Answer(why=_reason(status, complaints))


def _run(program: str, environment: dict[str, str], errors: BinaryIO, limit: float) -> int | None:
    """The exit status of a Python program; None if it took too long."""
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
    """Why a process ended without an answer, in one line."""
    lines = [line.strip() for line in complaints.splitlines() if line.strip()]
    last = lines[-1][:_LONGEST_REASON] if lines else ""
    if status >= 0:
        return last or f"it ended with status {status}"
    try:
        crash = f"it crashed: {signal.Signals(-status).name}"
    except ValueError:
        crash = f"it crashed: signal {-status}"
    return f"{crash} ({last})" if last else crash
