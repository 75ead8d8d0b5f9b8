"""Checks, each in a process of its own, so that a crash or a hang there does not stop this one.

    answer = ask("drawing", {"MUJOCO_GL": "egl"})
    print(answer.value if answer.why is None else answer.why)

`ask` calls a function of this module in a new process, which returns JSON types. A
probe that fails raises, and its error is the answer. Each probe imports what it needs.
"""

import contextlib
import dataclasses
import importlib
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

from limberjack import registry
from limberjack.utils.ffmpeg import find_ffmpeg
from limberjack.utils.files import write_whole
from limberjack.utils.requirements import broken_mujoco, is_of_mujoco

__all__ = [
    "Answer",
    "answer",
    "ask",
    "backends",
    "core",
    "devices",
    "dm_control",
    "domains",
    "drawing",
    "ffmpeg",
    "gpu",
    "threads",
]

_LARGEST = max(registry.TASKS, key=lambda row: row.dof)  # takes the most memory and time
_TASK = _LARGEST.domain, _LARGEST.task
_EPISODE = 0.25  # simulated seconds

_ROWS = 64
_ROUNDS = 4  # per number of threads; a round takes at least a twentieth of a second
_WARM_UP_STEPS = 2
_NEARLY_BEST = 0.95  # of the highest speed: further threads are better used elsewhere

_SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 .1"/>
    <geom size=".3" pos="0 0 .3" rgba=".8 .3 .1 1"/>
  </worldbody>
</mujoco>
"""
_SIZE = 64  # pixels per side

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


def answer(probe: str, file: str) -> None:
    """Writes the value that a probe returns, or the reason why it fails, to a file."""
    result: dict[str, object]
    try:
        result = {"value": globals()[probe]()}
    except Exception as error:
        if is_of_mujoco(error):  # the diagnosis has the commands that help
            error = ImportError(str(broken_mujoco(error)).partition(". ")[0])
        text = " ".join(str(error).split())
        result = {"why": f"{type(error).__name__}: {text}" if text else type(error).__name__}
    write_whole(Path(file), json.dumps(result))


def core() -> dict[str, int]:
    """The number of steps of a short episode.

    Raises:
      RuntimeError: a reward or an observation is not finite.
    """
    import numpy as np

    from limberjack import suite

    env = suite.load(*_TASK, task_kwargs={"random": 0, "time_limit": _EPISODE})
    action = np.full(env.action_spec().shape, 0.1)
    time_step, steps = env.reset(), 0
    while not time_step.last():
        time_step, steps = env.step(action), steps + 1
        observed = time_step.observation.values()
        if not all(math.isfinite(n) for n in [time_step.reward, *map(np.sum, observed)]):
            name = ":".join(_TASK)
            raise RuntimeError(f"{name}: step {steps} returned a number that is not finite")
    return {"steps": steps}


def threads() -> dict[str, object]:
    """Speed of a batch by number of threads, and the recommended number."""
    import numpy as np

    from limberjack import bench, gym
    from limberjack.utils import cores

    most = min(cores.usable_cores(), _ROWS)
    counts = sorted({most, *(2**i for i in range(most.bit_length()))})
    envs = {n: gym.load_vector(*_TASK, _ROWS, num_threads=n) for n in counts}
    for env in envs.values():
        env.reset(seed=0)
    shape = envs[most].batches[0].action_spec().shape
    random = np.random.RandomState(0)
    taken = bench.take_turns(
        {str(n): bench.player(env.step) for n, env in envs.items()},
        lambda num_steps: random.uniform(-1, 1, (num_steps, *shape)),
        seconds=0.0,
        min_rounds=_ROUNDS,
        warm_up_steps=_WARM_UP_STEPS,
    )
    # The fastest round counts: other programs can only slow a round down.
    speeds = {n: _ROWS / min(taken[str(n)]) for n in counts}
    enough = [n for n in counts if speeds[n] >= _NEARLY_BEST * max(speeds.values())]
    domain, task = _TASK
    return {
        "domain": domain,
        "task": task,
        "num_envs": _ROWS,
        "steps_per_second": [[n, speeds[n]] for n in counts],
        "recommended": enough[0],
    }


def domains() -> Mapping[str, Mapping[str, str | None]]:
    """Domains that installed packages provide: modules by name, and problems by name."""
    from limberjack import suite

    problems = suite.find_installed()
    found = registry.domains().values()
    others = {domain.name: domain.import_name for domain in found if domain.source != "suite"}
    return {"found": others, "problems": problems}


def backends() -> list[str]:
    """The platform's OpenGL backends, in the order in which they are tried."""
    from limberjack.mujoco.rendering import backends

    return list(backends.names())


def drawing() -> dict[str, str]:
    """Draws a picture with the backend that the environment variables select, and names it.

    Raises:
      RenderingError: no OpenGL context can be created.
      RuntimeError: all pixels have one colour.
    """
    from limberjack.mujoco import Physics, rendering

    try:
        picture = Physics.from_xml_string(_SCENE).render(_SIZE, _SIZE)
    except rendering.RenderingError as error:
        if len(error.failures) == 1:
            ((name, why),) = error.failures.items()
            return {"name": name, "why": why}
        return {"name": "", "why": " ".join(str(error).split())}
    backend = rendering.backend()
    assert backend is not None
    if picture.min() == picture.max():
        raise RuntimeError(f"{backend.renderer!r} draws all pixels in one colour")
    return {"name": backend.name, "renderer": backend.renderer, "vendor": backend.vendor}


def devices() -> list[str | None]:
    """The renderer of each EGL device, by number; None where a device has no OpenGL."""
    from limberjack.mujoco.rendering.egl import Egl

    return Egl.devices()


def ffmpeg() -> str:
    """The version of the ffmpeg that writes films."""
    command = [find_ffmpeg(), "-version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    words = done.stdout.split()  # ffmpeg version 7.0.2 Copyright ...
    return words[2] if words[:2] == ["ffmpeg", "version"] else "of an unknown version"


def dm_control() -> str:
    """Loads a task with an installed dm_control, whose errors it passes on."""
    # Any: the package may be missing.
    suite: Any = importlib.import_module("dm_control.suite")
    suite.load(*_TASK).reset()
    return "loads"


def gpu() -> list[str]:
    """The CUDA devices that MuJoCo Warp can use, with their memory; raises if there are none."""
    from limberjack.gpu import backend

    return backend.devices()


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
