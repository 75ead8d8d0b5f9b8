"""What `limberjack.doctor.examine` finds: plain values, which `dataclasses.asdict` makes JSON of.

Check(works=False, version="1.0.50", why="AttributeError: ...")
"""

import dataclasses
from collections.abc import Mapping

__all__ = ["Backend", "Check", "Diagnosis", "Extra", "Threads"]


@dataclasses.dataclass(frozen=True)
class Check:
    """Whether something works; if not, `why`."""

    works: bool
    version: str | None = None  # None: not installed, or it does not say
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Backend:
    """Whether a picture can be drawn by a source of OpenGL; if not, why and what to do."""

    name: str  # as MUJOCO_GL has it; may be empty where none works
    works: bool
    renderer: str = ""  # the driver's name for what draws; may be empty where the backend works
    vendor: str = ""
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Threads:
    """Steps per second of a batch with several numbers of threads."""

    domain: str
    task: str
    num_envs: int
    steps_per_second: Mapping[int, float]  # of all rows together, by number of threads
    recommended: int | None  # None: it could not be measured
    why: str = ""


@dataclasses.dataclass(frozen=True)
class Extra:
    """An optional part of Limberjack, as its metadata has it."""

    name: str
    missing: tuple[str, ...]  # distributions; empty where it is installed
    command: str  # that installs it

    @property
    def is_installed(self) -> bool:
        """Whether nothing is missing."""
        return not self.missing


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """All of it."""

    core: Check  # a short episode steps, and its numbers are finite
    versions: Mapping[str, str | None]  # None: not installed
    system: str
    usable_cores: int  # that the scheduler grants this process
    total_cores: int
    threads: Threads
    variables: Mapping[str, str | None]  # those of the environment that choose OpenGL
    drawing: Backend  # what a program draws with that is started here
    backends: tuple[Backend, ...]
    devices: tuple[str | None, ...]  # EGL's, by number: what draws there; None where nothing does
    extras: tuple[Extra, ...]
    ffmpeg: Check
    domains: Mapping[str, str]  # those of installed packages: their modules by name
    dm_control: Check  # an installed one, on this MuJoCo
    problems: tuple[str, ...]  # a sentence each, with the next move
