"""MuJoCo's constants, such as `constants.mjMAXVAL`, looked up in the official package."""

from typing import Any

import mujoco

__all__: list[str] = []


def __getattr__(name: str) -> Any:  # names of MuJoCo's own package
    value = getattr(mujoco, name, None) if name.startswith("mj") else None
    if not isinstance(value, (int, float)):
        raise AttributeError(f"MuJoCo {mujoco.mj_versionString()} has no constant {name!r}")
    return value
