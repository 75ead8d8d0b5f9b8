"""Changes to MuJoCo Studio's modules that last as long as a viewer.

    with replaced(web_server, "serve", guard.serve), private_settings(ux):
        ...

Studio has no options for these. The modules are given, so this file imports none of them.
"""

import contextlib
import functools
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

__all__ = ["private_settings", "replaced"]

_SETTINGS = ("load_settings", "load_theme", "reset_config", "save_settings")


@contextlib.contextmanager
def replaced(module: ModuleType, name: str, value: object) -> Iterator[None]:
    """Gives an attribute of a module another value, and its own one back at the end."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


@contextlib.contextmanager
def private_settings(ux: ModuleType) -> Iterator[None]:
    """Keeps Studio's settings in a temporary file: ~/.mujoco.ini is neither read nor written.

    Args:
      ux: `mujoco.studio.ux`.
    """
    with tempfile.TemporaryDirectory() as directory, contextlib.ExitStack() as patches:
        path = str(Path(directory) / "studio.ini")
        for name in _SETTINGS:
            function = functools.partial(getattr(ux, name), ini_path=path)
            patches.enter_context(replaced(ux, name, function))
        yield
