"""EGL: OpenGL on a GPU, or with Mesa's software renderer, without a display server.

    backend = Egl()              # the device of MUJOCO_EGL_DEVICE_ID, or the first that works
    print(backend.renderer)
    for device in Egl.devices():
        print(device)            # "NVIDIA H100", or None if it has no working context

The library is called directly instead of through PyOpenGL; see `backends.py`.
"""

import copy
import ctypes
import os
from collections.abc import Iterator
from typing import Self

from limberjack.mujoco.rendering import native
from limberjack.mujoco.rendering.native import RenderingError, fail

__all__ = ["VARIABLE", "Egl", "device_in_environment"]

VARIABLE = "MUJOCO_EGL_DEVICE_ID"


def device_in_environment() -> str | None:
    """The value of MUJOCO_EGL_DEVICE_ID; None if it is unset or empty."""
    return os.environ.get(VARIABLE) or None


class Egl:
    """Contexts of one device."""

    name = "egl"

    _DEVICE, _SURFACELESS = 0x313F, 0x31DD  # EGL_PLATFORM_DEVICE_EXT, ..._SURFACELESS_MESA
    _OPENGL_API = 0x30A2
    _NONE = 0x3038  # ends a list of attributes
    _MOST_DEVICES = 64
    # Pairs of an attribute and its minimum: 8 bits each of red, green, blue and alpha, 24 of depth,
    # 8 of stencil; RGB buffers, off-screen surfaces and OpenGL. Ends with EGL_NONE.
    _ATTRIBUTES = (
        *(0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8, 0x3025, 24, 0x3026, 8),
        *(0x303F, 0x308E, 0x3033, 0x1, 0x3040, 0x8, _NONE),
    )
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

    def __init__(self, surfaceless: bool = False, device: int | None = None) -> None:
        """Opens the given device, or that of MUJOCO_EGL_DEVICE_ID, or the first that works.

        Args:
          surfaceless: whether to open Mesa's renderer without a device.
          device: the device's number in the driver's order.

        Raises:
          UnavailableError: EGL does not work here.
          RenderingError: the requested device does not exist or has no working context.
        """
        self._open_library()
        self.is_surfaceless = surfaceless
        wanted = device_in_environment() if device is None else str(device)
        source = VARIABLE if device is None else "device"
        for platform, place in self._places(wanted, source):
            if self._use(platform, place):
                # Makes EGL visible to MuJoCo; only now, so that it cannot find a failing backend.
                native.load("libEGL.so.1", is_visible=True)
                return
        if wanted is not None and not surfaceless:
            raise RenderingError(
                f"{source}={wanted!r}: this EGL device cannot create an OpenGL context. Choose "
                "another; `limberjack doctor` lists them"
            )
        fail("no EGL device can create an OpenGL context")

    @classmethod
    def devices(cls) -> list[str | None]:
        """The renderer of each device, in the driver's order; None if it has no working context.

        Raises:
          UnavailableError: EGL does not work here.
        """
        egl = cls.__new__(cls)
        egl._open_library()
        found = egl._found_devices()
        return [egl.renderer if egl._use(cls._DEVICE, device) else None for device in found]

    def _open_library(self) -> None:
        # NVIDIA's driver needs it for use by several threads.
        native.load("libOpenGL.so.0", is_visible=True)
        self._egl = native.load("libEGL.so.1") or fail("libEGL.so.1 cannot be loaded")
        if native.is_visible("OSMesaGetProcAddress") and not native.is_visible("eglGetProcAddress"):
            fail("this process already draws with OSMesa")
        for name, signature in self._SIGNATURES.items():
            native.declare(getattr(self._egl, name), signature)

    def _places(self, wanted: str | None, source: str) -> Iterator[tuple[int, int | None]]:
        """Platforms to try, each with its device."""
        if not self.is_surfaceless:
            for device in self._devices(wanted, source):
                yield self._DEVICE, device
        if self.is_surfaceless or wanted is None:
            self.is_surfaceless = True
            yield self._SURFACELESS, None

    def _devices(self, wanted: str | None, source: str) -> list[int | None]:
        """Devices to try, in the driver's order."""
        devices = self._found_devices()
        if wanted is None:
            return devices
        if not wanted.isdecimal() or int(wanted) >= len(devices):
            numbers = f"0 to {len(devices) - 1}" if len(devices) > 1 else "only 0"
            raise RenderingError(
                f"{source}={wanted!r} is not an EGL device; expected a number: "
                f"{numbers if devices else 'none, as there are no devices'}. `limberjack doctor` "
                "lists them"
            )
        return [devices[int(wanted)]]

    def _found_devices(self) -> list[int | None]:
        """All devices, in the driver's order."""
        found, count = (ctypes.c_void_p * self._MOST_DEVICES)(), ctypes.c_int32()
        query = self._extension(*self._QUERY_DEVICES)
        if not query(self._MOST_DEVICES, found, ctypes.byref(count)):
            fail("EGL's devices cannot be listed")
        return list(found)[: count.value]

    def another(self) -> Self | None:
        """A second display of the same device; None if there is none.

        Mesa's software renderer fills the pixels of one picture at a time for each display. A
        display is found by its attributes, and Mesa tells an empty list of them from no list.
        """
        other = copy.copy(self)
        no_attributes = (ctypes.c_int32 * 1)(self._NONE)
        if not other._use(*self._place, no_attributes) or other._display == self._display:
            return None
        return other

    def _use(
        self,
        platform: int,
        device: int | None,
        of_display: "ctypes.Array[ctypes.c_int32] | None" = None,
    ) -> bool:
        """Adopts a display with these attributes if it has a working context; returns whether."""
        display = self._extension(*self._GET_DISPLAY)(platform, device, of_display)
        egl, config, count = self._egl, ctypes.c_void_p(), ctypes.c_int32()
        attributes = (ctypes.c_int32 * len(self._ATTRIBUTES))(*self._ATTRIBUTES)
        if not display or not egl.eglInitialize(display, None, None):
            return False
        egl.eglChooseConfig(display, attributes, ctypes.byref(config), 1, ctypes.byref(count))
        self._place, self._display, self._config = (platform, device), display, config
        context = count.value and self.create()
        if not context or not egl.eglMakeCurrent(display, None, None, context):
            return False
        self.renderer, self.vendor = native.names_of_driver(self._extension("glGetString", "su"))
        self.make_current(None)
        self.destroy(context)
        return True

    def _extension(self, name: str, signature: str) -> "ctypes._CFunctionType":
        """An extension function, which the library does not export by name."""
        address = self._egl.eglGetProcAddress(name.encode()) or fail(f"EGL has no {name}")
        return native.function_at(address, signature)

    def create(self) -> int | None:
        """A new context, not current; None if it cannot be created."""
        self._egl.eglBindAPI(self._OPENGL_API)
        return self._egl.eglCreateContext(self._display, self._config, None, None)

    def make_current(self, context: object) -> None:
        """Makes the context current in this thread; None releases the current one."""
        if not self._egl.eglMakeCurrent(self._display, None, None, context):
            raise RenderingError("EGL could not make its context current")

    def destroy(self, context: object) -> None:
        """Frees the context, which must not be current."""
        self._egl.eglDestroyContext(self._display, context)
