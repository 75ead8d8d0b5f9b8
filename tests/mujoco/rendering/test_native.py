"""Loading and calling C libraries."""

import ctypes
import sys

import pytest

from limberjack.mujoco.rendering import native

_linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for Linux's C library")


@_linux
def test_an_existing_library_is_loaded_and_a_missing_one_is_none() -> None:
    assert native.load("libc.so.6") is not None
    assert native.load("libno-such-thing.so.1") is None


@_linux
def test_a_declared_function_takes_and_returns_the_types_of_its_signature() -> None:
    library = native.load("libc.so.6")
    assert library is not None
    native.declare(library.strlen, "us")
    assert library.strlen(b"limber") == 6
    with pytest.raises(ctypes.ArgumentError):
        library.strlen(3.0)


@_linux
def test_a_function_is_called_by_its_address() -> None:
    library = native.load("libc.so.6")
    assert library is not None
    address = ctypes.cast(library.abs, ctypes.c_void_p).value
    assert address is not None
    assert native.function_at(address, "ii")(-7) == 7


@_linux
def test_functions_of_the_c_library_are_visible_to_all() -> None:
    assert native.is_visible("strlen")
    assert not native.is_visible("no_such_function")


def test_fail_can_be_used_in_an_expression() -> None:
    with pytest.raises(native.UnavailableError, match="no library"):
        native.load("libno-such-thing.so.1") or native.fail("no library")


def test_the_driver_is_named_by_its_context_and_none_is_refused() -> None:
    names = {0x1F01: b"llvmpipe", 0x1F00: b"Mesa"}
    assert native.names_of_driver(names.get) == ("llvmpipe", "Mesa")
    assert native.names_of_driver({0x1F01: b"\xffnvidia"}.get) == ("\ufffdnvidia", "")
    with pytest.raises(native.UnavailableError, match="context does not work"):
        native.names_of_driver({}.get)


def test_a_rendering_error_has_no_failures_unless_backends_were_tried() -> None:
    assert native.RenderingError("switched off").failures == {}
