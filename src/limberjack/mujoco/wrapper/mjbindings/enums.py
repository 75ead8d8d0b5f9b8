"""MuJoCo's enums as named tuples of ints, such as `enums.mjtJoint.mjJNT_HINGE`.

Each is created from the official enum on first use.
"""

import collections
from typing import Any

import mujoco

__all__: list[str] = []


def __getattr__(name: str) -> Any:  # names of MuJoCo's own package
    official = getattr(mujoco, name, None) if name.startswith(("mjt", "mjr")) else None
    members = getattr(official, "__members__", None)
    if not members:
        raise AttributeError(f"MuJoCo {mujoco.mj_versionString()} has no enum {name!r}")
    made = collections.namedtuple(name, members)(*(int(value.value) for value in members.values()))
    globals()[name] = made
    return made
