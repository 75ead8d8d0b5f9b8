"""dm_control, loaded on MuJoCo 4.0 in the same process as Limberjack.

    from .oracle import BOTH, ours, theirs
    env = theirs("suite").load("humanoid", "walk", {"random": 0})
    twins = [package("suite").load("humanoid", "walk", {"random": 0}) for package in BOTH]

dm_control 1.0.50 does not load on MuJoCo 4.0 as installed. Its table of array sizes was generated
from MuJoCo 3.17, `index.struct_indexer` reads every field that the table names, and nine of them
(`flex_vertedge` and others of flexible bodies) are gone: `AttributeError`. Importing this module
deletes from the table the names that the installed MuJoCo's structs lack. Nothing else of
dm_control is changed, and no domain uses those fields.

A test module that imports this one is skipped where dm_control is not installed.
"""

import importlib
import importlib.util
import os
from types import ModuleType

import mujoco
import pytest

__all__ = ["BOTH", "NO_RENDERING", "REMOVED_FIELDS", "needs_rendering", "ours", "theirs"]

_NOT_INSTALLED = (
    "dm_control is not installed; on Python 3.13 and newer it cannot be, because its dependency "
    "labmaze has no wheel there"
)
NO_RENDERING = os.environ.get("MUJOCO_GL", "").lower() in (
    "disable",
    "disabled",
    "off",
    "false",
    "0",
)
needs_rendering = pytest.mark.skipif(NO_RENDERING, reason="MUJOCO_GL turns rendering off")


def ours(name: str) -> ModuleType:
    """The module of that name below `limberjack`."""
    return importlib.import_module(f"limberjack.{name}")


def theirs(name: str) -> ModuleType:
    """The module of that name below `dm_control`."""
    return importlib.import_module(f"dm_control.{name}")


def _load_on_this_mujoco() -> list[str]:
    """Makes dm_control loadable; the names that it had to delete from its size tables."""
    # dm_control takes MuJoCo's warnings for itself. They stay Limberjack's, whose own tests look
    # for them in this process.
    ours("mujoco")
    warnings_go_to = mujoco.get_mju_user_warning()
    tables = theirs("mujoco.wrapper.mjbindings.sizes").array_sizes
    mujoco.set_mju_user_warning(warnings_go_to)
    removed = []
    for struct, fields in (("mjmodel", mujoco.MjModel), ("mjdata", mujoco.MjData)):
        for name in [name for name in tables[struct] if not hasattr(fields, name)]:
            del tables[struct][name]
            removed.append(name)
    return removed


BOTH = (ours, theirs)
if importlib.util.find_spec("dm_control") is None:
    pytest.skip(_NOT_INSTALLED, allow_module_level=True)
REMOVED_FIELDS = _load_on_this_mujoco()
