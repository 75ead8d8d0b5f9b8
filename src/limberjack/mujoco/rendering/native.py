"""Loading and calling OpenGL's C libraries, and the errors of rendering.

    egl = load("libEGL.so.1") or fail("libEGL.so.1 cannot be loaded")
    declare(egl.eglInitialize, "uppp")
    renderer, vendor = names_of_driver(get_string)

A signature has one letter for the return type and one for each argument: i(nt), u(nsigned),
p(ointer), s(tring).
"""

import ctypes
from collections.abc import Callable, Mapping
from typing import NoReturn

__all__ = [
    "RenderingError",
    "UnavailableError",
    "declare",
    "fail",
    "function_at",
    "is_visible",
    "load",
    "names_of_driver",
]

_GL_VENDOR, _GL_RENDERER = 0x1F00, 0x1F01
_CType = type[ctypes.c_int32 | ctypes.c_uint32 | ctypes.c_void_p | ctypes.c_char_p]


class RenderingError(RuntimeError):
    """Rendering is impossible: OpenGL is missing, switched off or broken.

    `failures` maps each backend that was tried to the reason for its failure and a remedy.
    """

    failures: Mapping[str, str] = {}


class UnavailableError(Exception):
    """A backend does not work here; the message has the reason."""


def fail(reason: str) -> NoReturn:
    """Raises `UnavailableError`; a function, for use after `or`."""
    raise UnavailableError(reason) from None


def load(library: str, is_visible: bool = False) -> ctypes.CDLL | None:
    """The library, or None; if `is_visible`, its symbols become visible to the whole process."""
    try:
        return ctypes.CDLL(library, mode=ctypes.RTLD_GLOBAL if is_visible else ctypes.RTLD_LOCAL)
    except OSError:
        return None


def is_visible(function: str) -> bool:
    """Whether the function is visible to the process, and so to MuJoCo."""
    return hasattr(ctypes.CDLL(None), function)


def declare(function: "ctypes._NamedFuncPointer", signature: str) -> None:
    """Sets the signature of a ctypes function."""
    function.restype, *function.argtypes = _types(signature)


def function_at(address: int, signature: str) -> "ctypes._CFunctionType":
    """The function at an address."""
    return ctypes.CFUNCTYPE(*_types(signature))(address)


def names_of_driver(get_string: Callable[[int], bytes | None]) -> tuple[str, str]:
    """Renderer and vendor, from the current context's glGetString.

    Raises:
      UnavailableError: the context does not work.
    """
    names = [get_string(what) for what in (_GL_RENDERER, _GL_VENDOR)]
    if not names[0]:
        fail("its OpenGL context does not work")
    renderer, vendor = ((name or b"").decode(errors="replace") for name in names)
    return renderer, vendor


def _types(signature: str) -> list[_CType]:
    """The C types of the letters of a signature."""
    letters: dict[str, _CType] = {
        "i": ctypes.c_int32,
        "u": ctypes.c_uint32,
        "p": ctypes.c_void_p,
        "s": ctypes.c_char_p,
    }
    return [letters[letter] for letter in signature]
