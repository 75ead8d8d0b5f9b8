"""Cost and modules of importing a suite; each function is called in a fresh process.

Nothing is imported here at first but the clock, so that what is timed pays for all that it needs.
"""

import importlib
import sys
import time

__all__ = ["opengl_modules", "seconds_to_import"]

_OPENGL = ("OpenGL", "glfw", "mujoco.egl", "mujoco.glfw", "mujoco.osmesa")


def seconds_to_import(package: str) -> dict[str, float]:
    """Seconds for `import mujoco, dm_env, gymnasium`, and what a package adds to it.

    'alone' is `import <package>`, 'added' is `import <package>.suite`, with the former.
    """
    start = time.perf_counter()
    for base in ("mujoco", "dm_env", "gymnasium"):
        importlib.import_module(base)
    between = time.perf_counter()
    importlib.import_module(package)
    alone = time.perf_counter() - between
    import peers  # imports only what MuJoCo has imported already

    peers.suite(package)
    return {"base": between - start, "alone": alone, "added": time.perf_counter() - between}


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
