"""OpenGL backends for off-screen rendering: EGL, OSMesa, GLFW and CGL.

    backend = open_backend()      # the one selected by MUJOCO_GL, or the first that works
    context = backend.create()
    backend.make_current(context)
    backend.destroy(context)

All calls must come from a thread of `thread.py`, always the same one for a backend. EGL (see
`egl.py`) and OSMesa are called directly instead of through PyOpenGL, which supports only one of
them per process, selected by an environment variable. A backend counts as open only after it has
created a working context, because MuJoCo looks up OpenGL's functions once per process and caches a
failure.
"""

import ctypes
import importlib
import os
import sys
from collections.abc import Callable
from typing import Any, Protocol

from limberjack.mujoco.rendering import native
from limberjack.mujoco.rendering.egl import Egl, device_in_environment
from limberjack.mujoco.rendering.native import RenderingError, UnavailableError, fail
from limberjack.utils.suggest import did_you_mean

__all__ = ["Backend", "RenderingError", "names", "open_backend", "opened_again"]

_VARIABLE = "MUJOCO_GL"
# Values of MUJOCO_GL that MuJoCo accepts besides the backends' names.
_OFF = ("disable", "disabled", "off", "false", "0")
_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_GLFW_ALIASES = {"linux": "glx", "win32": "wgl"}

_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast")
_MESA_LIBRARIES = ("libEGL_mesa", "libgallium", "swrast_dri")

_NOT_AFTER_FORK = (
    "this process was forked from one that had rendered with {!r}, which does not survive a fork. "
    "Start processes with multiprocessing's 'spawn' or 'forkserver', or fork before rendering"
)


class Backend(Protocol):
    """A source of OpenGL contexts, which are opaque: numbers, or objects of a library."""

    name: str  # the value of MUJOCO_GL that selects it
    # The driver's strings for the renderer, such as "llvmpipe (LLVM 15.0.6, 256 bits)", and for its
    # vendor; may be empty.
    renderer: str
    vendor: str

    def create(self) -> object:
        """A new context, not current."""
        ...

    def make_current(self, context: object) -> None:
        """Makes the context current in this thread; None releases the current one."""
        ...

    def destroy(self, context: object) -> None:
        """Frees the context, which must not be current."""
        ...


def names() -> tuple[str, ...]:
    """The platform's backends in the order of preference."""
    available = {"linux": ("egl", "osmesa", "glfw"), "darwin": ("cgl", "glfw")}
    return available.get(sys.platform, ("glfw",))


def open_backend(
    is_forked: bool = False, inherited: Backend | None = None, device: int | None = None
) -> Backend:
    """The backend selected by MUJOCO_GL; if unset, the platform's first backend that works.

    Args:
      is_forked: whether this process was forked. A forked process has a copy of the driver's memory
        but not its threads, so using the driver would hang. Mesa can be opened again through a
        different entry point.
      inherited: the backend used by the parent process.
      device: number of the EGL device; by default that of MUJOCO_EGL_DEVICE_ID.

    Raises:
      RenderingError: MUJOCO_GL is unknown or disables rendering, no backend works, the device does
        not exist, or the inherited backend cannot be opened again.
    """
    chosen = _choice(os.environ.get(_VARIABLE, "").lower().strip(), device)
    if inherited is not None or (is_forked and "egl" in chosen and _is_mesa_loaded()):
        try:
            return _reopened(inherited)
        except UnavailableError:
            if inherited is not None:
                raise RenderingError(_NOT_AFTER_FORK.format(inherited.renderer)) from None
    failures = {}
    for name in chosen:
        opener, remedy = _BACKENDS[name]
        try:
            return opener() if device is None else Egl(device=device)
        except UnavailableError as error:
            failures[name] = f"{error}; {remedy}"
    tried = "".join(f"\n  {name}: {why}" for name, why in failures.items())
    error = RenderingError(f"no OpenGL backend works here. Tried:{tried}")
    error.failures = failures
    raise error


def opened_again(backend: Backend) -> Backend | None:
    """A backend that draws at the same time as this one, with equal pixels; None if there is none.

    Only Mesa's software renderer through EGL has one. It needs a thread of its own.
    """
    return backend.another() if isinstance(backend, Egl) and _is_software(backend) else None


def _is_software(backend: Backend) -> bool:
    """Whether it is a software renderer of Mesa."""
    return any(name in backend.renderer for name in _SOFTWARE_RENDERERS)


def _reopened(inherited: Backend | None) -> Backend:
    """Mesa's software renderer, through an entry point that the parent process did not use."""
    if inherited is not None:
        is_mesa = _is_software(inherited)
        if not isinstance(inherited, Egl) or inherited.is_surfaceless or not is_mesa:
            fail("not Mesa's software renderer, or already opened again after a fork")
    return Egl(surfaceless=True)


def _is_mesa_loaded() -> bool:
    """Whether Mesa is loaded, by this process or before the fork."""
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
        return any(library in line for line in maps for library in _MESA_LIBRARIES)


def _choice(value: str, device: int | None) -> tuple[str, ...]:
    """Names of the backends to try for a value of MUJOCO_GL and a requested device."""
    chosen = _named(value)
    if device is not None and "egl" not in chosen:
        raise RenderingError(
            f"device {device} was requested, but only EGL has devices; the backends selected here "
            f"are: {', '.join(chosen)}"
        )
    # A requested device must not be silently replaced by software rendering.
    is_named = device is not None or device_in_environment() is not None
    return ("egl",) if is_named and "egl" in chosen else chosen


def _named(value: str) -> tuple[str, ...]:
    """Names of the backends that a value of MUJOCO_GL stands for."""
    if value in _AUTOMATIC:
        return names()
    if value in _OFF:
        raise RenderingError(
            f"rendering is switched off: {_VARIABLE}={value!r}. Unset it for automatic selection, "
            f"or set it to one of: {', '.join(names())}"
        )
    if value in names():
        return (value,)
    if value == _GLFW_ALIASES.get(sys.platform):
        return ("glfw",)
    raise RenderingError(
        f"{_VARIABLE}={value!r} is not a backend for {sys.platform}. Unset it for automatic "
        f"selection, or set it to one of: {', '.join(names())}, disable."
        f"{did_you_mean(value, names())}"
    )


class _OsMesa:
    """Contexts of Mesa's software renderer through its off-screen library."""

    name = "osmesa"

    _LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
    _RGBA, _FLOAT = 0x1908, 0x1406
    _DEPTH_BITS, _STENCIL_BITS = 24, 8
    # Size in pixels of OSMesa's buffer, which is unused: MuJoCo draws into its own buffers.
    _SIDE = 8
    _SIGNATURES = {  # noqa: RUF012
        "OSMesaCreateContextExt": "puiiip",
        "OSMesaMakeCurrent": "uppuii",
        "OSMesaDestroyContext": "up",
        "OSMesaGetProcAddress": "ps",
    }

    def __init__(self) -> None:
        if native.is_visible("eglGetProcAddress"):
            fail("this process already draws with EGL")
        libraries = filter(None, map(native.load, self._LIBRARIES))
        self._mesa = next(libraries, None) or fail("libOSMesa cannot be loaded")
        for name, signature in self._SIGNATURES.items():
            native.declare(getattr(self._mesa, name), signature)
        self._buffer = (ctypes.c_float * (4 * self._SIDE**2))()
        context = self.create()
        if not context:
            fail("OSMesa cannot create an OpenGL context")
        self.make_current(context)
        get_string = self._mesa.OSMesaGetProcAddress(b"glGetString")
        get_string = native.function_at(get_string, "su")
        self.renderer, self.vendor = native.names_of_driver(get_string)
        self.make_current(None)
        self.destroy(context)
        native.load(self._mesa._name, is_visible=True)

    def create(self) -> int | None:
        bits = (self._DEPTH_BITS, self._STENCIL_BITS, 0)
        return self._mesa.OSMesaCreateContextExt(self._RGBA, *bits, None)

    def make_current(self, context: object) -> None:
        buffer, side = (self._buffer, self._SIDE) if context else (None, 0)
        if not self._mesa.OSMesaMakeCurrent(context, buffer, self._FLOAT, side, side) and context:
            raise RenderingError("OSMesa could not make its context current")

    def destroy(self, context: object) -> None:
        self._mesa.OSMesaDestroyContext(context)


class _Glfw:
    """Contexts of hidden windows; needs a display server."""

    name = "glfw"

    def __init__(self) -> None:
        if sys.platform == "darwin":
            fail("on macOS, GLFW works only in the main thread")
        if sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
            fail("there is no display: DISPLAY and WAYLAND_DISPLAY are not set")
        try:
            self._glfw: Any = importlib.import_module("glfw")  # Any: it has no types
        except ImportError as error:
            fail(str(error))
        reporting, self._glfw.ERROR_REPORTING = self._glfw.ERROR_REPORTING, "raise"
        try:
            self._glfw.init()
            self.destroy(self.create())
        except self._glfw.GLFWError as error:
            fail(str(error))
        finally:
            self._glfw.ERROR_REPORTING = reporting
        self.renderer = self.vendor = ""
        if sys.platform == "linux":
            native.load("libGL.so.1", is_visible=True)

    def create(self) -> object:
        self._glfw.window_hint(self._glfw.VISIBLE, False)
        return self._glfw.create_window(1, 1, "limberjack", None, None)

    def make_current(self, context: object) -> None:
        self._glfw.make_context_current(context)

    def destroy(self, context: object) -> None:
        self._glfw.destroy_window(context)


class _Cgl:
    """macOS contexts without a window, through MuJoCo's own binding."""

    name = "cgl"

    def __init__(self) -> None:
        try:
            self._cgl = importlib.import_module("mujoco.cgl")
            self.destroy(self.create())
        except (ImportError, AttributeError, OSError, RuntimeError) as error:
            fail(str(error))
        self.renderer = self.vendor = ""

    def create(self) -> object:
        return self._cgl.GLContext(1, 1)

    # Any: a GLContext of MuJoCo's.
    def make_current(self, context: Any) -> None:
        if context is not None:
            context.make_current()

    def destroy(self, context: Any) -> None:  # Any: as above
        context.free()


# Each backend's class, and advice for when it does not work.
_BACKENDS: dict[str, tuple[Callable[[], Backend], str]] = {
    "egl": (
        Egl,
        "install a GPU driver, or Mesa (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri)",
    ),
    "osmesa": (_OsMesa, "install it (Debian, Ubuntu: apt install libosmesa6)"),
    "glfw": (_Glfw, "run it in a desktop session"),
    "cgl": (_Cgl, "it is part of macOS"),
}
