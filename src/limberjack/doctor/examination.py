"""`examine`: runs all probes and collects their answers in a `Diagnosis`.

    diagnosis = examine()

Results are plain values, which `dataclasses.asdict` turns into JSON.
"""

import dataclasses
import os
import platform
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor

from limberjack.doctor import packages, probes
from limberjack.doctor.packages import Extra
from limberjack.doctor.probes import Answer
from limberjack.utils import cores
from limberjack.utils.requirements import MUJOCO_BROKEN, broken_mujoco

__all__ = ["Backend", "Check", "Diagnosis", "Threads", "examine"]

_VARIABLES = ("MUJOCO_GL", "MUJOCO_EGL_DEVICE_ID")
_DM_CONTROL_REMEDY = (
    "Limberjack needs MuJoCo 4, in which dm_control up to 1.0.50 does not load: install dm_control "
    "in a virtual environment of its own"
)


@dataclasses.dataclass(frozen=True)
class Check:
    """Whether something works, and if not, the reason."""

    works: bool
    version: str | None = None  # None: not installed, or unknown
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Backend:
    """Whether an OpenGL backend can draw a picture; if not, the reason and the remedy."""

    name: str  # a value of MUJOCO_GL; may be empty where no backend works
    works: bool
    renderer: str = ""  # as the driver names it; may be empty where the backend works
    vendor: str = ""
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Threads:
    """Speed of a batch by number of threads."""

    domain: str
    task: str
    num_envs: int
    steps_per_second: Mapping[int, float]  # of all rows together; keys are numbers of threads
    recommended: int | None  # None: it could not be measured
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """All results."""

    core: Check  # whether a short episode steps, with finite numbers
    versions: Mapping[str, str | None]  # None: not installed
    system: str
    usable_cores: int  # those that the scheduler grants this process
    total_cores: int
    threads: Threads
    variables: Mapping[str, str | None]  # the environment variables that select OpenGL
    drawing: Backend  # the backend that a program started here would use
    backends: tuple[Backend, ...]
    devices: tuple[str | None, ...]  # renderers of EGL's devices, by number; None: no OpenGL there
    extras: tuple[Extra, ...]
    ffmpeg: Check
    domains: Mapping[str, str]  # domains that installed packages provide: module by name
    dm_control: Check  # whether an installed dm_control loads with this MuJoCo
    gpu: Check  # whether `limberjack.gpu` can use a CUDA device; its version is their names
    problems: tuple[str, ...]  # one sentence each, with the remedy


def examine(ask: Callable[..., Answer] = probes.ask) -> Diagnosis:
    """Examines this machine, which takes about ten seconds.

    Args:
      ask: runs a probe, given its name and environment variables; tests pass their own.
    """
    domains = ask("domains")
    core, threads = ask("core"), ask("threads")  # not in parallel: the second measures speed
    names = ask("backends").value or ()
    with ThreadPoolExecutor(max_workers=cores.usable_cores()) as pool:
        drawing = pool.submit(ask, "drawing")
        each = [pool.submit(ask, "drawing", {"MUJOCO_GL": name}) for name in names]
        others = [pool.submit(ask, probe) for probe in ("devices", "ffmpeg", "dm_control", "gpu")]
    devices, ffmpeg, dm_control, gpu = (future.result() for future in others)
    backend = _backend("", drawing.result())
    return Diagnosis(
        core=_check(core, packages.version("mujoco")),
        versions=packages.versions(),
        system=platform.platform(),
        usable_cores=cores.usable_cores(),
        total_cores=os.cpu_count() or 1,
        threads=_threads(threads),
        variables={name: os.environ.get(name) for name in _VARIABLES},
        drawing=backend,
        backends=tuple(map(_backend, names, (future.result() for future in each))),
        devices=tuple(devices.value or ()),
        extras=packages.extras(),
        ffmpeg=_check(ffmpeg, ffmpeg.value),
        domains=(domains.value or {}).get("found", {}),
        dm_control=_check_of_dm_control(dm_control),
        gpu=_check(gpu, "; ".join(gpu.value or ()) or None),
        problems=tuple(packages.clashes() or _problems(core, backend, domains)),
    )


def _check(answer: Answer, version: str | None) -> Check:
    return Check(answer.why is None, version, answer.why or "")


def _check_of_dm_control(answer: Answer) -> Check:
    version = packages.version("dm_control")
    if version is None:
        return Check(False, None, "not installed")
    if answer.why is None:
        return Check(True, version)
    return Check(False, version, f"{answer.why}; {_DM_CONTROL_REMEDY}")


def _backend(name: str, answer: Answer) -> Backend:
    """The result of the probe that draws a picture."""
    if answer.why is not None:
        return Backend(name, works=False, why=answer.why)
    found = {"name": name, **answer.value}
    return Backend(works="why" not in found, **found)


def _threads(answer: Answer) -> Threads:
    if answer.why is not None:
        return Threads("", "", 0, {}, None, answer.why)
    found = dict(answer.value)
    speeds = {int(number): speed for number, speed in found.pop("steps_per_second")}
    return Threads(steps_per_second=speeds, **found)


def _problems(core: Answer, backend: Backend, domains: Answer) -> Iterator[str]:
    """Problems of this machine, the worst first; clashes of packages would cause all of them."""
    if core.why is not None and MUJOCO_BROKEN in core.why:
        yield str(broken_mujoco(core.why.partition(": ")[2]))
        return  # everything else needs MuJoCo
    if core.why is not None:
        yield (
            f"environments do not step: {core.why}. Install Limberjack again, in a new virtual "
            "environment"
        )
    if not backend.works:
        yield f"no pictures can be drawn; everything else works without. {backend.why}"
    if domains.why is not None:
        yield f"the domains that installed packages provide cannot be listed: {domains.why}"
        return
    for name, why in domains.value["problems"].items():
        yield f"domain {name!r} of an installed package cannot be used: {why}"
