"""The official `mujoco`, imported without OpenGL.

    from limberjack.mujoco.official import mujoco

A plain `import mujoco` loads the OpenGL backend selected by the variable MUJOCO_GL, and fails if
the value is invalid. Here this is deferred to the first use of `mujoco.GLContext` or
`mujoco.Renderer`, when MuJoCo's own code reads MUJOCO_GL, with the same results and errors. If the
program has already imported `mujoco`, that module stays unchanged. So do environment variables.

Modules imported after this one may use `import mujoco`.
"""

import importlib
import importlib.util
import os
import sys
from collections.abc import Callable
from types import ModuleType

from limberjack.utils.requirements import broken_mujoco

__all__ = ["mujoco"]

_VARIABLE = "MUJOCO_GL"
_WITHOUT_OPENGL = "disable"  # the value that MuJoCo defines
_CONTEXT = "GLContext"
# The module that reads MUJOCO_GL on import, and the modules that import `GLContext` from it.
_SELECTING = "mujoco.rendering.classic.gl_context"
_TAKING = ("mujoco", "mujoco.rendering.classic.renderer")


def _import_without_opengl() -> None:
    """Imports `mujoco` and defers OpenGL to first use."""
    before = os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = _WITHOUT_OPENGL
    try:
        importlib.import_module("mujoco")
    except ImportError as error:
        raise broken_mujoco(error) from None
    finally:
        if before is None:
            os.environ.pop(_VARIABLE, None)
        else:
            os.environ[_VARIABLE] = before
    selecting = sys.modules.get(_SELECTING)
    if selecting is None:  # a MuJoCo built without rendering
        return
    for module in filter(None, map(sys.modules.get, (_SELECTING, *_TAKING))):
        # The renderer's module has None if there is no context class.
        vars(module).pop(_CONTEXT, None)
        vars(module)["__getattr__"] = _lazy_getattr(module, selecting)


def _lazy_getattr(module: ModuleType, selecting: ModuleType) -> Callable[[str], object]:
    """A `__getattr__` for `module` that resolves `GLContext`, then falls back to its own."""
    own = vars(module).get("__getattr__")

    def getattr_(name: str) -> object:
        if name == _CONTEXT or (name == "__all__" and module is selecting):
            _select(selecting)
            if name in vars(module):
                return vars(module)[name]
        if own is not None:
            return own(name)
        raise AttributeError(f"module {module.__name__!r} has no attribute {name!r}")

    return getattr_


def _select(selecting: ModuleType) -> None:
    """Defines `GLContext` according to MUJOCO_GL's current value, or raises MuJoCo's error.

    Looking up `__all__` also leads here, since `from ... import *` reads it first.
    """
    if _CONTEXT not in vars(selecting):
        importlib.reload(selecting)
    if _CONTEXT in vars(selecting):
        for module in filter(None, map(sys.modules.get, _TAKING)):
            vars(module)[_CONTEXT] = vars(selecting)[_CONTEXT]


if "mujoco" not in sys.modules:
    _import_without_opengl()

if importlib.util.find_spec("mujoco.batch") is None:
    raise broken_mujoco(
        "limberjack needs mujoco.batch, which requires MuJoCo 4.0 or later, but mujoco "
        f"{getattr(sys.modules['mujoco'], '__version__', 'of an unknown version')} is installed"
    )

mujoco = sys.modules["mujoco"]
