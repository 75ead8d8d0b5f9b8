"""Tests of limberjack.mujoco.rendering.backends."""

import ast
import ctypes.util
import sys
from collections.abc import Callable
from typing import Any

import pytest

from limberjack.mujoco.rendering import RenderingError, backends, native, use_device
from limberjack.mujoco.rendering.egl import Egl

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="EGL and OSMesa are Linux's")
with_osmesa = pytest.mark.skipif(
    ctypes.util.find_library("OSMesa") is None, reason="libOSMesa is not installed"
)

# Draws, and prints the error, or the backend and the sum of the pixels.
_DRAW = """
from limberjack.mujoco import Physics
from limberjack.mujoco.rendering import RenderingError, backend, use_device
physics = Physics.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 3'/><geom size='.3'/></worldbody></mujoco>")
def draw():
    try:
        total = physics.render().sum()
        print(backend().name, total)
    except RenderingError as error:
        print(error)
draw()
"""


@on_linux
@pytest.mark.parametrize("value", [None, " EGL ", "on"])
def test_egl_comes_first_and_by_name(run_script: Callable[..., str], value: str | None) -> None:
    assert run_script(_DRAW, MUJOCO_GL=value).startswith("egl ")


@on_linux
@with_osmesa
def test_osmesa_renders_for_any_pyopengl_platform(run_script: Callable[..., str]) -> None:
    printed = run_script(_DRAW, MUJOCO_GL="osmesa", PYOPENGL_PLATFORM="egl")
    assert printed.startswith("osmesa ")


@on_linux
@with_osmesa
def test_osmesa_draws_where_egl_cannot(run_script: Callable[..., str]) -> None:
    by_osmesa = run_script(_DRAW, MUJOCO_GL="osmesa")
    without_drivers = {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent", "DISPLAY": None}
    assert run_script(_DRAW, MUJOCO_GL=None, **without_drivers) == by_osmesa


@on_linux
@pytest.mark.parametrize(("device", "backend"), [("99", "egl"), ("-1", None), ("first", "egl")])
def test_an_unknown_device_is_refused_and_not_replaced(
    run_script: Callable[..., str], device: str, backend: str | None
) -> None:
    printed = run_script(_DRAW, MUJOCO_GL=backend, MUJOCO_EGL_DEVICE_ID=device)
    assert f"MUJOCO_EGL_DEVICE_ID={device!r} is not an EGL device; expected a number" in printed
    assert "limberjack doctor" in printed


@on_linux
def test_a_device_of_the_environment_is_not_replaced_by_software(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for device, chosen in (("0", ("egl",)), ("", backends.names())):
        monkeypatch.setenv("MUJOCO_EGL_DEVICE_ID", device)
        assert backends._choice("", None) == chosen
    assert backends._choice("", 0) == ("egl",)


def test_a_device_just_past_the_last_one_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    egl = Egl.__new__(Egl)
    monkeypatch.setattr(egl, "_found_devices", lambda: [1, 2])
    assert egl._devices("1", "device") == [2]
    with pytest.raises(RenderingError, match=r"device='2' is not an EGL device; .*: 0 to 1\."):
        egl._devices("2", "device")


def test_a_graphics_card_has_no_second_backend() -> None:
    egl = Egl.__new__(Egl)
    egl.renderer = "NVIDIA H200"
    assert backends.opened_again(egl) is None


@on_linux
@pytest.mark.parametrize("device", ["0", ""])
def test_an_existing_device_renders(run_script: Callable[..., str], device: str) -> None:
    assert run_script(_DRAW, MUJOCO_EGL_DEVICE_ID=device).startswith("egl ")


@on_linux
def test_a_program_can_choose_the_device_before_the_first_picture(
    run_script: Callable[..., str],
) -> None:
    script = f"""{_DRAW.removesuffix("draw()" + chr(10))}
for number in (99, 0):
    use_device(number)
    draw()
try:
    use_device(1)
except RuntimeError as error:
    print(error)
"""
    # The environment is not asked.
    refused, drawn, late = run_script(script, MUJOCO_EGL_DEVICE_ID="77").splitlines()
    assert "device='99' is not an EGL device" in refused
    assert drawn.startswith("egl ")
    assert "select the device before the first picture" in late


@on_linux
def test_a_device_is_refused_where_another_backend_draws(run_script: Callable[..., str]) -> None:
    script = _DRAW.replace("def draw", "use_device(0)\ndef draw")
    assert "only EGL has devices" in run_script(script, MUJOCO_GL="osmesa")


@pytest.mark.parametrize(("number", "error"), [(-1, ValueError), ("0", TypeError)])
def test_invalid_device_numbers_are_refused(number: Any, error: type[Exception]) -> None:
    with pytest.raises(error):
        use_device(number)


@on_linux
def test_egl_devices_are_listed_by_renderer(run_script: Callable[..., str]) -> None:
    script = "from limberjack.mujoco.rendering.egl import Egl; print(Egl.devices())"
    found = ast.literal_eval(run_script(script))
    # None is a graphics card without its driver.
    assert any(found)
    number = next(k for k, renderer in enumerate(found) if renderer)
    assert run_script(_DRAW, MUJOCO_EGL_DEVICE_ID=str(number)).startswith("egl ")


@pytest.mark.parametrize("value", ["disable", "FALSE"])
def test_rendering_can_be_switched_off(run_script: Callable[..., str], value: str) -> None:
    printed = run_script(_DRAW, MUJOCO_GL=value)
    assert "switched off" in printed
    assert f"MUJOCO_GL={value.lower()!r}" in printed


@pytest.mark.parametrize("value", ["nonsense", "elg", "cgl" if sys.platform == "linux" else "egl"])
def test_an_unknown_backend_is_an_error_that_lists_those_there_are(
    run_script: Callable[..., str], value: str
) -> None:
    printed = run_script(_DRAW, MUJOCO_GL=value)
    assert f"MUJOCO_GL={value!r} is not a backend" in printed
    assert "glfw, disable" in printed
    assert value != "elg" or "Did you mean 'egl'?" in printed


@on_linux
def test_the_variable_is_read_again_after_a_failure(run_script: Callable[..., str]) -> None:
    script = f"import os\n{_DRAW}\nos.environ['MUJOCO_GL'] = 'egl'\ndraw()\n"
    first, second = run_script(script, MUJOCO_GL="nonsense").splitlines()
    assert "'nonsense'" in first
    assert second.startswith("egl ")


@on_linux
def test_glfw_without_a_display_is_an_error(run_script: Callable[..., str]) -> None:
    nothing = {"DISPLAY": None, "WAYLAND_DISPLAY": None}
    assert "there is no display" in run_script(_DRAW, MUJOCO_GL="glfw", **nothing)
    assert "glfw: " in run_script(_DRAW, MUJOCO_GL="glfw", **(nothing | {"DISPLAY": ":77"}))


@on_linux
def test_where_nothing_works_each_backend_its_reason_and_remedy_are_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for variable in ("MUJOCO_GL", "MUJOCO_EGL_DEVICE_ID", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    # As where none of the libraries is installed.
    monkeypatch.setattr(native, "load", lambda *args, **kwargs: None)
    monkeypatch.setattr(native, "is_visible", lambda function: False)
    with pytest.raises(RenderingError) as caught:
        backends.open_backend()
    lines = str(caught.value).splitlines()
    assert [line.split(":")[0].strip() for line in lines[1:]] == ["egl", "osmesa", "glfw"]
    assert "libEGL.so.1 cannot be loaded" in lines[1]
    assert "apt install libegl1 libgl1-mesa-dri" in lines[1]
    assert "apt install libosmesa6" in lines[2]
    assert "DISPLAY" in lines[3]
    assert list(caught.value.failures) == ["egl", "osmesa", "glfw"]


def test_a_rendering_error_is_a_runtime_error() -> None:
    assert issubclass(RenderingError, RuntimeError)


@on_linux
@with_osmesa
@pytest.mark.parametrize(("mine", "others"), [("osmesa", "egl"), ("egl", "osmesa")])
def test_opengl_that_another_library_has_chosen_is_not_mixed(
    run_script: Callable[..., str], mine: str, others: str
) -> None:
    # MuJoCo has one table of OpenGL's functions: those of two libraries cannot both be in it.
    script = f"""
import importlib, os
import limberjack.mujoco
os.environ["MUJOCO_GL"] = {others!r}
context = importlib.import_module("mujoco.{others}").GLContext(32, 32)
os.environ["MUJOCO_GL"] = {mine!r}
{_DRAW}
context.free()
"""
    assert "already draws with" in run_script(script)


# Makes contexts of a backend and of the one that it is opened again as.
_AGAIN = """
from limberjack.mujoco.rendering import backends
first = backends.open_backend()
second = backends.opened_again(first)
if second is not None:
    assert second._display != first._display
    assert second.renderer == first.renderer
    for each in (first, second, first):
        context = each.create()
        each.make_current(context)
        each.make_current(None)
        each.destroy(context)
print(first.name, second is None)
"""


@on_linux
def test_mesa_is_opened_a_second_time(run_script: Callable[..., str]) -> None:
    if not backends._is_software(backends.open_backend()):
        pytest.skip("drawn by a graphics card")
    assert run_script(_AGAIN, MUJOCO_GL="egl") == "egl False\n"


@on_linux
@with_osmesa
def test_osmesa_is_opened_once(run_script: Callable[..., str]) -> None:
    assert run_script(_AGAIN, MUJOCO_GL="osmesa") == "osmesa True\n"
