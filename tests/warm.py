"""Programs in processes that are forked from one that has imported what they begin with.

    printed = warm.run(program, *arguments)                  # as programs.run
    printed = warm.run(program, imports=warm.DM_CONTROL, warnings="ignore")

A third of a second of each program is the import of NumPy, MuJoCo and Gymnasium, and more than a
second that of dm_control. Of the package itself nothing is imported ahead but `limberjack.mujoco`:
a program that forgets an import fails as in a fresh process.

Not for tests of what is imported or set at the start of a process, of threads, or of exits: those
take `programs.run`.
"""

import atexit
import functools
import json
import os
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

from tests import programs

__all__ = ["DM_CONTROL", "OURS", "run"]

# `limberjack.mujoco` first: it prepares the import of MuJoCo.
OURS = """
import limberjack.mujoco
import gymnasium, numpy
for _name in ("matplotlib.figure", "pyarrow.parquet"):
    try:
        __import__(_name)
    except ImportError:
        pass
"""
DM_CONTROL = "import tests.oracle.oracle, dm_control.suite, gymnasium"

# Reads a job from each line of its input, forks, and prints the status of the child. The child
# leaves the loop and is, from then on, like `python -c PROGRAM`: the lines after the loop are the
# last ones of its main module, so that Python reports errors and ends as it always does.
_LOOP = """
import gc, json, os, signal, sys, warnings
exec(sys.argv[1])
gc.collect()
gc.freeze()  # or each child searches, and so copies, all that was imported
for _line in iter(sys.stdin.readline, ""):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Python warns of NumPy's threads, which wait
        _child = os.fork()
    if not _child:
        break
    print(os.waitstatus_to_exitcode(os.waitpid(_child, 0)[1]), flush=True)
else:
    sys.exit()
_job = json.loads(_line)
for _number, _file in enumerate((os.devnull, _job["out"], _job["errors"])):
    os.dup2(os.open(_file, os.O_WRONLY if _number else os.O_RDONLY), _number)
signal.alarm(_job["limit"])
os.environ.clear()
os.environ.update(_job["environment"])
os.chdir(_job["directory"])
sys.argv = ["-c", *_job["arguments"]]
sys.path[:] = ["", *_job["first"], *sys.path[1:]]
exec(
    (lambda code, names: ([names.pop(one) for one in [*names] if one[:2] != "__"], code)[1])(
        compile(_job["program"], "<string>", "exec"), globals()
    )
)
"""


def run(
    program: str,
    *arguments: str,
    path: Path | None = None,
    warnings: str = "error",
    imports: str = OURS,
) -> str:
    """The program's output; fails unless it exits with status 0 and an empty standard error.

    Args:
      program: its text.
      arguments: in `sys.argv`.
      path: put first on the module search path.
      warnings: the warning filter.
      imports: what the process has imported that is forked; anything is imported without them too.
    """
    if not hasattr(os, "fork"):
        return programs.run(program, *arguments, path=path, warnings=warnings)
    process = _process(imports, warnings, os.environ.get("MUJOCO_GL"))
    assert process.stdin is not None
    assert process.stdout is not None
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, name) for name in ("out", "errors")]
        for file in files:
            file.touch()
        job = {
            "program": textwrap.dedent(program),
            "arguments": arguments,
            "first": [] if path is None else [str(path)],
            "environment": programs.environment(path),
            "directory": os.getcwd(),
            "limit": programs.LIMIT,
            "out": str(files[0]),
            "errors": str(files[1]),
        }
        process.stdin.write(json.dumps(job) + "\n")
        process.stdin.flush()
        status = process.stdout.readline().strip()
        printed, errors = (file.read_text() for file in files)
    assert status == "0", errors or f"status {status!r}"
    assert errors == "", errors
    return printed


@functools.cache
def _process(imports: str, warnings: str, opengl: str | None) -> "subprocess.Popen[str]":
    """The process that forks; it ends when this one closes its input.

    MuJoCo reads the variable `opengl` when it is imported.
    """
    process = subprocess.Popen(
        [sys.executable, "-W", warnings, "-c", _LOOP, imports],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=programs.environment(Path(__file__).parents[1]),
    )
    atexit.register(process.communicate)
    return process
