"""Results of `limberjack.doctor.examine`: plain values, which `dataclasses.asdict` turns into JSON.

Check(works=False, version="1.0.50", why="AttributeError: ...")
"""

import dataclasses
from collections.abc import Mapping

__all__ = ["Backend", "Check", "Diagnosis", "Extra", "Threads"]


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
class Extra:
    """An optional feature of Limberjack and the packages that it needs."""

    name: str
    missing: tuple[str, ...]  # packages that are not installed
    command: str  # installs the packages of this extra

    @property
    def is_installed(self) -> bool:
        """Whether all packages of the extra are installed."""
        return not self.missing


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
