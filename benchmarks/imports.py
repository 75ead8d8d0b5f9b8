"""The cost of imports and the modules that they load; each function runs in a fresh process.

Only the clock is imported at module level, so that each measurement includes everything it needs.
"""

import importlib
import sys
import time

__all__ = ["opengl_modules", "seconds_to_import", "seconds_to_import_alone"]

_OPENGL = ("OpenGL", "glfw", "mujoco.egl", "mujoco.glfw", "mujoco.osmesa")


def seconds_to_import(package: str) -> dict[str, float]:
    """Seconds for `import mujoco, dm_env, gymnasium`, and the time that `<package>.suite` adds."""
    start = time.perf_counter()
    for name in ("mujoco", "dm_env", "gymnasium"):
        importlib.import_module(name)
    between = time.perf_counter()
    import peers  # imports only what MuJoCo has imported already

    peers.suite(package)
    return {"base": between - start, "added": time.perf_counter() - between}


def seconds_to_import_alone(package: str) -> dict[str, float]:
    """Seconds for `import gymnasium`, and the time that `import <package>` adds."""
    start = time.perf_counter()
    importlib.import_module("gymnasium")
    between = time.perf_counter()
    importlib.import_module(package)
    return {"base": between - start, "added": time.perf_counter() - between}


def opengl_modules() -> list[str]:
    """Modules of OpenGL after Limberjack's import and each task's load, reset and step."""
    suite = importlib.import_module("limberjack.suite")
    for domain, task in suite.ALL_TASKS:
        environment = suite.load(domain, task)
        environment.reset()
        environment.step(environment.action_spec().generate_value())
    return sorted(
        name
        for name in sys.modules
        if any(name == root or name.startswith(f"{root}.") for root in _OPENGL)
    )
