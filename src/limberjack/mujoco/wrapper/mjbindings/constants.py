"""MuJoCo's constants, such as `constants.mjMAXVAL`, looked up in the official package."""

import mujoco

__all__: list[str] = []


def __getattr__(name: str) -> int | float:
    value = getattr(mujoco, name, None) if name.startswith("mj") else None
    if not isinstance(value, (int, float)):
        raise AttributeError(f"MuJoCo {mujoco.mj_versionString()} has no constant {name!r}")
    return value
