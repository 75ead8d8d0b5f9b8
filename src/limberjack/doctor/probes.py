"""What is tried in a process of its own; `child.ask` calls these, and each returns JSON's types.

    probes.answer("drawing", "answer.json")     # {"value": {"name": "egl", ...}, "why": null}

A probe that fails raises; its error is the answer. Everything is imported by the probe that needs
it.
"""

import importlib
import json
import math
import os
import subprocess
from typing import Any

from limberjack import registry

__all__ = [
    "answer",
    "backends",
    "core",
    "devices",
    "dm_control",
    "domains",
    "drawing",
    "ffmpeg",
    "threads",
]

_TASK = registry.largest_task()  # it takes the most memory and time
_EPISODE = 0.25  # simulated seconds

_ROWS = 64
_ROUNDS = 4  # for each number of threads, each a twentieth of a second or more
_WARM_UP_STEPS = 2
_NEARLY_BEST = 0.95  # of the highest speed: threads beyond it are better used elsewhere

_SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="2 2 .1"/>
    <geom size=".3" pos="0 0 .3" rgba=".8 .3 .1 1"/>
  </worldbody>
</mujoco>
"""
_SIZE = 64  # pixels a side


def answer(probe: str, file: str) -> None:
    """Writes what a probe returns, or why it fails, to a file."""
    result: dict[str, object]
    try:
        result = {"value": globals()[probe]()}
    except Exception as error:
        text = " ".join(str(error).split())
        result = {"why": f"{type(error).__name__}: {text}" if text else type(error).__name__}
    partial = f"{file}.partial"
    with open(partial, "w", encoding="utf-8") as stream:
        json.dump(result, stream)
    os.replace(partial, file)


def core() -> dict[str, int]:
    """Steps a short episode; how many steps it had.

    Raises:
      RuntimeError: a number is not finite.
    """
    import numpy as np

    from limberjack import rollout, suite

    def check(step: rollout.Step) -> None:
        observed = step.time_step.observation.values()
        if not all(math.isfinite(n) for n in [step.reward, *map(np.sum, observed)]):
            name = ":".join(_TASK)
            raise RuntimeError(f"{name}: step {step.number} gave a number that is not finite")

    env = suite.load(*_TASK, task_kwargs={"random": 0, "time_limit": _EPISODE})
    action = np.full(env.action_spec().shape, 0.1)
    episode = rollout.run_episode(env, lambda spec, seed: lambda observation: action, 0, check)
    return {"steps": episode.length}


def threads() -> dict[str, object]:
    """Steps per second of a batch by number of threads, and the number to take."""
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
    # What else the machine does can only slow a round.
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


def domains() -> dict[str, Any]:
    """Modules of the domains of installed packages by name, and what is wrong with the others."""
    from limberjack import suite

    problems = suite.find_installed()
    found = registry.domains().values()
    others = {domain.name: domain.import_name for domain in found if domain.source != "suite"}
    return {"found": others, "problems": problems}


def backends() -> list[str]:
    """The platform's sources of OpenGL, in the order in which they are tried."""
    from limberjack.mujoco.rendering import backends

    return list(backends.names())


def drawing() -> dict[str, str]:
    """Draws a picture as the environment's variables say; what drew it.

    Raises:
      RenderingError: OpenGL cannot be had.
      RuntimeError: what was drawn is of one colour.
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
        raise RuntimeError(f"{backend.renderer!r} draws pictures of one colour")
    return {"name": backend.name, "renderer": backend.renderer, "vendor": backend.vendor}


def devices() -> list[str | None]:
    """What draws on each of EGL's devices, by number; None where nothing does."""
    from limberjack.mujoco.rendering.egl import Egl

    return Egl.devices()


def ffmpeg() -> str:
    """The version of the ffmpeg that films are written with."""
    from limberjack import video

    command = [video.find_ffmpeg(), "-version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    words = done.stdout.split()  # ffmpeg version 7.0.2 Copyright ...
    return words[2] if words[:2] == ["ffmpeg", "version"] else "of an unknown version"


def dm_control() -> str:
    """Loads a task of an installed dm_control; raises whatever it raises."""
    # Any: a package that need not be installed.
    suite: Any = importlib.import_module("dm_control.suite")
    suite.load(*_TASK).reset()
    return "loads"
