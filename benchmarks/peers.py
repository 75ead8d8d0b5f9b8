"""Limberjack and dm_control side by side in one process, and the models that both compile.

    for package in peers.installed():
        env = peers.suite(package).load("humanoid", "walk", {"random": 0})

dm_control 1.0.50 does not load on MuJoCo 4.0 as installed: its table of array sizes was generated
from MuJoCo 3.17, and every field that it names is read, of which nine are gone. Before its suite is
imported the names that the installed MuJoCo's structs lack are deleted from that table. Nothing
else of it is changed, and no domain uses those fields.
"""

import importlib
import importlib.util
import os
from collections.abc import Mapping
from types import ModuleType
from typing import Any

__all__ = [
    "OURS",
    "THEIRS",
    "WITHOUT_OPENGL",
    "first_tasks",
    "installed",
    "source",
    "suite",
]

OURS = "limberjack"
THEIRS = "dm_control"

# Environment variables of timed processes: nothing is rendered, and an unavailable backend would
# make the import of dm_control fail.
WITHOUT_OPENGL = {"MUJOCO_GL": "disable"}


def installed() -> list[str]:
    """The packages to measure: Limberjack, and dm_control if it is installed."""
    return [OURS, THEIRS] if importlib.util.find_spec(THEIRS) else [OURS]


def suite(package: str, draws: bool = False) -> ModuleType:
    """`limberjack.suite` or `dm_control.suite`.

    Args:
      package: the package's name.
      draws: whether dm_control needs to render, with the OpenGL that MUJOCO_GL selects; must be set
        in the first call.
    """
    if package == THEIRS:
        _make_loadable({} if draws else WITHOUT_OPENGL)
    found: Any = importlib.import_module(f"{package}.suite")
    if package == THEIRS and not draws:
        found.quadruped.Physics.contexts = None  # each start of escape would open OpenGL
    return found


class _SourceFoundError(Exception):
    """Carries the source of a model out of a load, which ends before the model is compiled."""


def source(domain: str, task: str) -> tuple[str, dict[str, bytes]]:
    """The MJCF of Limberjack's task and the files that it includes; nothing is compiled."""
    physics: Any = importlib.import_module(f"{OURS}.mujoco").Physics
    from_shared_xml = vars(physics)["from_shared_xml"]

    def found(cls: Any, xml: str | bytes, assets: dict[str, bytes]) -> Any:
        raise _SourceFoundError(xml, assets)

    physics.from_shared_xml = classmethod(found)
    try:
        suite(OURS).load(domain, task)
        raise RuntimeError(f"loading {domain} {task} compiled no model")
    except _SourceFoundError as error:
        xml, assets = error.args
    finally:
        physics.from_shared_xml = from_shared_xml
    return (xml.decode() if isinstance(xml, bytes) else xml), assets


def first_tasks() -> list[tuple[str, str]]:
    """The ten tasks that were here first, for which the bars of some benchmarks were set."""
    domains = ("humanoid", "manipulator", "stacker")
    return [task for task in suite(OURS).ALL_TASKS if task[0] in domains]


def _make_loadable(variables: Mapping[str, str]) -> None:
    """Imports dm_control and removes missing fields from its table; see the module's docstring."""
    before = dict(os.environ)
    os.environ.update(variables)
    try:
        mujoco: Any = importlib.import_module("mujoco")
        sizes: Any = importlib.import_module(f"{THEIRS}.mujoco.wrapper.mjbindings.sizes")
    finally:
        for name in variables:
            os.environ.pop(name)
            os.environ.update({name: before[name]} if name in before else {})
    for struct, fields in (("mjmodel", mujoco.MjModel), ("mjdata", mujoco.MjData)):
        names = sizes.array_sizes[struct]
        for name in [name for name in names if not hasattr(fields, name)]:
            del names[name]
