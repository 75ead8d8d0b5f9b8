"""Where OpenGL comes from: EGL, OSMesa, GLFW or CGL, without a window on the screen.

    backend = open_backend()      # as MUJOCO_GL says, or the first that works
    context = backend.create()
    backend.make_current(context)
    backend.destroy(context)

All calls must come from one thread: `gl.py`'s. EGL and OSMesa are called directly and not through
PyOpenGL, which can serve only one of them in a process and needs an environment variable to know
which. A backend is opened only once it has given a working context, because MuJoCo looks for
OpenGL's functions one time in the life of a process and remembers a failure.
"""

import ctypes
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from typing import Any, Protocol

__all__ = ["Backend", "RenderingError", "open_backend"]

_VARIABLE = "MUJOCO_GL"
_DEVICE_VARIABLE = "MUJOCO_EGL_DEVICE_ID"
# MuJoCo's words, besides the backends' names.
_OFF = ("disable", "disabled", "off", "false", "0")
_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_GLFW_ALIASES = {"linux": "glx", "win32": "wgl"}

_SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast")
_MESA_LIBRARIES = ("libEGL_mesa", "libgallium", "swrast_dri")
_GL_RENDERER = 0x1F01

_NOT_AFTER_FORK = (
    "this process was forked from one that had drawn with {!r}, which does not survive that. Start "
    "processes with multiprocessing's 'spawn' or 'forkserver', or draw nothing before forking them"
)


class RenderingError(RuntimeError):
    """No picture can be drawn: OpenGL is missing, switched off or broken."""


class Backend(Protocol):
    """A source of OpenGL contexts. Contexts are opaque: what `create` returned."""

    # The driver's name for what draws, such as "llvmpipe (LLVM 15.0.6, 256 bits)"; may be empty.
    renderer: str

    def create(self) -> Any:
        """A new context, not current."""
        ...

    def make_current(self, context: Any) -> None:
        """Makes the context current in this thread; None releases the current one."""
        ...

    def destroy(self, context: Any) -> None:
        """Frees the context, which must not be current."""
        ...


class _UnavailableError(Exception):
    """A backend does not work here, and why."""


def open_backend(is_forked: bool = False, inherited: Backend | None = None) -> Backend:
    """The backend that MUJOCO_GL names; without it, the first of the platform's that works.

    Args:
      is_forked: this process was forked from another. What a driver kept in memory came along, but
        not its threads: to use it again hangs. Mesa can be opened afresh, by another way in.
      inherited: what that process had drawn with.

    Raises:
      RenderingError: MUJOCO_GL is unknown or switches rendering off, nothing works, or what was
        inherited cannot be opened again.
    """
    names = _choice(os.environ.get(_VARIABLE, "").lower().strip())
    if inherited is not None or (is_forked and "egl" in names and _is_mesa_loaded()):
        try:
            return _open_afresh(inherited)
        except _UnavailableError:
            if inherited is not None:
                raise RenderingError(_NOT_AFTER_FORK.format(inherited.renderer)) from None
    failures = []
    for name in names:
        opener, remedy = _BACKENDS[name]
        try:
            return opener()
        except _UnavailableError as error:
            failures.append(f"\n  {name}: {error}; {remedy}")
    raise RenderingError(f"no OpenGL could be had to draw with. Tried:{''.join(failures)}")


def _open_afresh(inherited: Backend | None) -> Backend:
    """Mesa's software renderer, by a way that the process that this was forked from did not use."""
    if inherited is not None:
        is_software = any(name in inherited.renderer for name in _SOFTWARE_RENDERERS)
        if not isinstance(inherited, _Egl) or inherited.is_surfaceless or not is_software:
            _fail("not Mesa's, or opened afresh once already")
    return _Egl(surfaceless=True)


def _is_mesa_loaded() -> bool:
    """Whether somebody has drawn with Mesa, here or before the fork."""
    with open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
        return any(library in line for line in maps for library in _MESA_LIBRARIES)


def _choice(value: str) -> tuple[str, ...]:
    """The names of the backends to try for a value of MUJOCO_GL."""
    available = {"linux": ("egl", "osmesa", "glfw"), "darwin": ("cgl", "glfw")}
    names = available.get(sys.platform, ("glfw",))
    if value in _AUTOMATIC:
        return names
    if value in _OFF:
        raise RenderingError(
            f"rendering is switched off: {_VARIABLE}={value!r}. Unset it to have a backend chosen, "
            f"or set it to one of: {', '.join(names)}"
        )
    if value in names:
        return (value,)
    if value == _GLFW_ALIASES.get(sys.platform):
        return ("glfw",)
    raise RenderingError(
        f"{_VARIABLE}={value!r} is not a backend for {sys.platform}. Unset it to have one chosen, "
        f"or set it to one of: {', '.join(names)}, disable"
    )


class _Egl:
    """Contexts of a GPU, or of Mesa's software renderer, without a display server."""

    _DEVICE, _SURFACELESS = 0x313F, 0x31DD  # EGL_PLATFORM_DEVICE_EXT, ..._SURFACELESS_MESA
    _OPENGL_API = 0x30A2
    _MOST_DEVICES = 64
    # Pairs of an attribute and its least value: 8 bits each of red, green, blue and alpha, 24 of
    # depth, 8 of stencil; RGB, able to draw off-screen, able to do OpenGL. Then EGL_NONE.
    _ATTRIBUTES = (
        *(0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8, 0x3025, 24, 0x3026, 8),
        *(0x303F, 0x308E, 0x3033, 0x1, 0x3040, 0x8, 0x3038),
    )
    # Return and argument types: i(nt), u(nsigned), p(ointer), s(tring).
    _SIGNATURES = {  # noqa: RUF012
        "eglGetProcAddress": "ps",
        "eglInitialize": "uppp",
        "eglBindAPI": "uu",
        "eglChooseConfig": "upppip",
        "eglCreateContext": "ppppp",
        "eglMakeCurrent": "upppp",
        "eglDestroyContext": "upp",
    }
    _QUERY_DEVICES, _GET_DISPLAY = (
        ("eglQueryDevicesEXT", "uipp"),
        ("eglGetPlatformDisplayEXT", "pupp"),
    )

    def __init__(self, surfaceless: bool = False) -> None:
        """Opens the first device that works, or the one that MUJOCO_EGL_DEVICE_ID numbers.

        Args:
          surfaceless: open Mesa's renderer without naming a device.
        """
        _load(
            "libOpenGL.so.0", is_visible=True
        )  # NVIDIA's driver wants it for use by many threads.
        self._egl: Any = _load("libEGL.so.1") or _fail("libEGL.so.1 cannot be loaded")
        if _is_visible("OSMesaGetProcAddress") and not _is_visible("eglGetProcAddress"):
            _fail("this process already draws with OSMesa")
        for name, signature in self._SIGNATURES.items():
            _declare(getattr(self._egl, name), signature)
        self.is_surfaceless = surfaceless
        for display in self._displays():
            if self._use(display):
                # Here MuJoCo looks for functions; not sooner, lest it find those of one that fails.
                _load("libEGL.so.1", is_visible=True)
                return
        _fail("no EGL device gives an OpenGL context")

    def _displays(self) -> Iterator[int | None]:
        """The displays to try, not initialised."""
        get_display = self._extension(*self._GET_DISPLAY)
        if not self.is_surfaceless:
            for device in self._devices():
                yield get_display(self._DEVICE, device, None)
        if self.is_surfaceless or not os.environ.get(_DEVICE_VARIABLE):
            self.is_surfaceless = True
            yield get_display(self._SURFACELESS, None, None)

    def _devices(self) -> list[int | None]:
        """The devices to try, in the driver's order."""
        found, count = (ctypes.c_void_p * self._MOST_DEVICES)(), ctypes.c_int32()
        query = self._extension(*self._QUERY_DEVICES)
        if not query(self._MOST_DEVICES, found, ctypes.byref(count)):
            _fail("EGL's devices cannot be listed")
        devices = list(found)[: count.value]
        wanted = os.environ.get(_DEVICE_VARIABLE)
        if not wanted:
            return devices
        if not wanted.isdecimal() or int(wanted) >= len(devices):
            _fail(f"{_DEVICE_VARIABLE}={wanted!r}, but there are {len(devices)} devices, from 0")
        return [devices[int(wanted)]]

    def _use(self, display: int | None) -> bool:
        """Takes the display if a context of it works."""
        egl, config, count = self._egl, ctypes.c_void_p(), ctypes.c_int32()
        attributes = (ctypes.c_int32 * len(self._ATTRIBUTES))(*self._ATTRIBUTES)
        if not display or not egl.eglInitialize(display, None, None):
            return False
        egl.eglChooseConfig(display, attributes, ctypes.byref(config), 1, ctypes.byref(count))
        self._display, self._config = display, config
        context = count.value and self.create()
        if not context or not egl.eglMakeCurrent(display, None, None, context):
            return False
        self.renderer = _renderer(self._extension("glGetString", "su"))
        self.make_current(None)
        self.destroy(context)
        return True

    def _extension(self, name: str, signature: str) -> Any:
        """A function that the library does not export by name."""
        address = self._egl.eglGetProcAddress(name.encode())
        if not address:
            _fail(f"EGL has no {name}")
        return ctypes.CFUNCTYPE(*_types(signature))(address)

    def create(self) -> int | None:
        self._egl.eglBindAPI(self._OPENGL_API)
        return self._egl.eglCreateContext(self._display, self._config, None, None)

    def make_current(self, context: int | None) -> None:
        if not self._egl.eglMakeCurrent(self._display, None, None, context):
            raise RenderingError("EGL could not make its context current")

    def destroy(self, context: int | None) -> None:
        self._egl.eglDestroyContext(self._display, context)


class _OsMesa:
    """Contexts of Mesa's software renderer as a plain library."""

    _LIBRARIES = ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")
    _RGBA, _FLOAT = 0x1908, 0x1406
    _DEPTH_BITS, _STENCIL_BITS = 24, 8
    # Pixels a side of what OSMesa draws into; MuJoCo draws into buffers of its own.
    _SIDE = 8
    _SIGNATURES = {  # noqa: RUF012
        "OSMesaCreateContextExt": "puiiip",
        "OSMesaMakeCurrent": "uppuii",
        "OSMesaDestroyContext": "up",
        "OSMesaGetProcAddress": "ps",
    }

    def __init__(self) -> None:
        if _is_visible("eglGetProcAddress"):
            _fail("this process already draws with EGL")
        libraries = filter(None, map(_load, self._LIBRARIES))
        self._mesa: Any = next(libraries, None) or _fail("libOSMesa cannot be loaded")
        for name, signature in self._SIGNATURES.items():
            _declare(getattr(self._mesa, name), signature)
        self._buffer = (ctypes.c_float * (4 * self._SIDE**2))()
        context = self.create()
        if not context:
            _fail("OSMesa gives no OpenGL context")
        self.make_current(context)
        get_string = self._mesa.OSMesaGetProcAddress(b"glGetString")
        self.renderer = _renderer(ctypes.CFUNCTYPE(*_types("su"))(get_string))
        self.make_current(None)
        self.destroy(context)
        _load(self._mesa._name, is_visible=True)

    def create(self) -> int | None:
        bits = (self._DEPTH_BITS, self._STENCIL_BITS, 0)
        return self._mesa.OSMesaCreateContextExt(self._RGBA, *bits, None)

    def make_current(self, context: int | None) -> None:
        buffer, side = (self._buffer, self._SIDE) if context else (None, 0)
        if not self._mesa.OSMesaMakeCurrent(context, buffer, self._FLOAT, side, side) and context:
            raise RenderingError("OSMesa could not make its context current")

    def destroy(self, context: int | None) -> None:
        self._mesa.OSMesaDestroyContext(context)


class _Glfw:
    """Contexts of windows that are never shown; needs a display server."""

    def __init__(self) -> None:
        if sys.platform == "darwin":
            _fail("GLFW works in the main thread only on macOS")
        if sys.platform == "linux" and not any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY"))):
            _fail("there is no display: DISPLAY and WAYLAND_DISPLAY are not set")
        try:
            self._glfw: Any = importlib.import_module("glfw")
        except ImportError as error:
            _fail(str(error))
        reporting, self._glfw.ERROR_REPORTING = self._glfw.ERROR_REPORTING, "raise"
        try:
            self._glfw.init()
            self.destroy(self.create())
        except self._glfw.GLFWError as error:
            _fail(str(error))
        finally:
            self._glfw.ERROR_REPORTING = reporting
        self.renderer = ""
        if sys.platform == "linux":
            _load("libGL.so.1", is_visible=True)

    def create(self) -> Any:
        self._glfw.window_hint(self._glfw.VISIBLE, False)
        return self._glfw.create_window(1, 1, "limberjack", None, None)

    def make_current(self, context: Any) -> None:
        self._glfw.make_context_current(context)

    def destroy(self, context: Any) -> None:
        self._glfw.destroy_window(context)


class _Cgl:
    """macOS's contexts without a window, by MuJoCo's own binding."""

    def __init__(self) -> None:
        try:
            self._cgl: Any = importlib.import_module("mujoco.cgl")
            self.destroy(self.create())
        except (ImportError, AttributeError, OSError, RuntimeError) as error:
            _fail(str(error))
        self.renderer = ""

    def create(self) -> Any:
        return self._cgl.GLContext(1, 1)

    def make_current(self, context: Any) -> None:
        if context is not None:
            context.make_current()

    def destroy(self, context: Any) -> None:
        context.free()


# Each backend's class, and what to do where it does not work.
_BACKENDS: dict[str, tuple[Callable[[], Backend], str]] = {
    "egl": (
        _Egl,
        "install a GPU's driver, or Mesa (Debian, Ubuntu: apt install libegl1 libgl1-mesa-dri)",
    ),
    "osmesa": (_OsMesa, "install it (Debian, Ubuntu: apt install libosmesa6)"),
    "glfw": (_Glfw, "run it in a desktop session"),
    "cgl": (_Cgl, "it is part of macOS"),
}


def _fail(reason: str) -> Any:
    raise _UnavailableError(reason) from None


def _load(library: str, is_visible: bool = False) -> Any:
    """The library, or None; if visible, the whole process finds functions in it."""
    try:
        return ctypes.CDLL(library, mode=ctypes.RTLD_GLOBAL if is_visible else ctypes.RTLD_LOCAL)
    except OSError:
        return None


def _is_visible(function: str) -> bool:
    """Whether the process finds the function, as MuJoCo would."""
    return hasattr(ctypes.CDLL(None), function)


def _types(signature: str) -> list[Any]:
    """The C types that the letters stand for."""
    letters = {
        "i": ctypes.c_int32,
        "u": ctypes.c_uint32,
        "p": ctypes.c_void_p,
        "s": ctypes.c_char_p,
    }
    return [letters[letter] for letter in signature]


def _declare(function: Any, signature: str) -> None:
    """Tells ctypes the return type and the argument types."""
    function.restype, *function.argtypes = _types(signature)


def _renderer(get_string: Callable[[int], bytes | None]) -> str:
    """The name of what draws, by glGetString."""
    name = get_string(_GL_RENDERER)
    if not name:
        _fail("its OpenGL context does not work")
    return (name or b"").decode(errors="replace")
