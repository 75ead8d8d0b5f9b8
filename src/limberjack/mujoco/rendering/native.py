"""Calling OpenGL's libraries, which are written in C; and what goes wrong with them.

    egl = load("libEGL.so.1") or fail("libEGL.so.1 cannot be loaded")
    declare(egl.eglInitialize, "uppp")
    renderer, vendor = names_of_driver(get_string)

A signature is a letter for what a function returns and one for each argument: i(nt), u(nsigned),
p(ointer), s(tring).
"""

import ctypes
from collections.abc import Callable, Mapping
from typing import Any, NoReturn

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


class RenderingError(RuntimeError):
    """No picture can be drawn: OpenGL is missing, switched off or broken.

    `failures` has, for each backend that was tried, why it failed and what to do about that.
    """

    failures: Mapping[str, str] = {}


class UnavailableError(Exception):
    """A backend does not work here, and why."""


def fail(reason: str) -> NoReturn:
    """Raises an `UnavailableError`; an expression, to stand behind `or`."""
    raise UnavailableError(reason) from None


def load(library: str, is_visible: bool = False) -> ctypes.CDLL | None:
    """The library, or None; if visible, the whole process finds functions in it."""
    try:
        return ctypes.CDLL(library, mode=ctypes.RTLD_GLOBAL if is_visible else ctypes.RTLD_LOCAL)
    except OSError:
        return None


def is_visible(function: str) -> bool:
    """Whether the process finds the function, as MuJoCo would."""
    return hasattr(ctypes.CDLL(None), function)


def declare(function: "ctypes._NamedFuncPointer", signature: str) -> None:
    """Tells ctypes a function's signature."""
    function.restype, *function.argtypes = _types(signature)


def function_at(address: int, signature: str) -> Callable[..., Any]:
    """The function at an address. Any: whatever the signature says."""
    return ctypes.CFUNCTYPE(*_types(signature))(address)


def names_of_driver(get_string: Callable[[int], bytes | None]) -> tuple[str, str]:
    """What draws, and who made it, by the current context's glGetString.

    Raises:
      UnavailableError: there is no context that works.
    """
    names = [get_string(what) for what in (_GL_RENDERER, _GL_VENDOR)]
    if not names[0]:
        fail("its OpenGL context does not work")
    renderer, vendor = ((name or b"").decode(errors="replace") for name in names)
    return renderer, vendor


def _types(signature: str) -> list[type["ctypes._SimpleCData[Any]"]]:
    """The C types that the letters stand for."""
    letters = {
        "i": ctypes.c_int32,
        "u": ctypes.c_uint32,
        "p": ctypes.c_void_p,
        "s": ctypes.c_char_p,
    }
    return [letters[letter] for letter in signature]
