"""Checks that run in a process of their own: `child.ask` calls these, and each returns JSON types.

    probes.answer("drawing", "answer.json")     # {"value": {"name": "egl", ...}, "why": null}

A probe that fails raises, and its error is the answer. Each probe imports what it needs.
"""

import importlib
import json
import math
import subprocess
from pathlib import Path
from typing import Any

from limberjack import registry
from limberjack.utils.files import replacing
from limberjack.utils.requirements import broken_mujoco, is_of_mujoco

__all__ = [
    "answer",
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

_TASK = registry.largest_task()  # the task that takes the most memory and time
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
    with replacing(Path(file)) as partial:
        partial.write_text(json.dumps(result), encoding="utf-8")


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


def domains() -> dict[str, Any]:  # values of JSON
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
    from limberjack.see import video

    command = [video.find_ffmpeg(), "-version"]
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
    from limberjack.gpu import devices

    return devices.described()
