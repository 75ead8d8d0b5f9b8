"""Tests of limberjack.mujoco.official."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

# Prints what of OpenGL the process has loaded: Python's modules, and libraries.
_LOADED = """
import re, sys
def loaded():
    modules = [name for name in sys.modules if name.split(".")[0] in ("OpenGL", "glfw")]
    with open("/proc/self/maps") as maps:
        return sorted(set(modules + re.findall(r"lib(?:GL|EGL|OSMesa|OpenGL)[^/ ]*", maps.read())))
"""
_MODEL = "\"<mujoco><worldbody><geom size='1'/></worldbody></mujoco>\""

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")


@on_linux
@pytest.mark.parametrize("backend", ["egl", "glfw", None])
def test_nothing_of_opengl_is_loaded_to_import_load_reset_and_step(
    run_script: Callable[..., str], backend: str | None
) -> None:
    script = f"""{_LOADED}
import limberjack.mujoco
from limberjack import suite
env = suite.load("humanoid", "walk")
env.reset()
env.step(env.action_spec().generate_value())
camera = limberjack.mujoco.Camera(env.physics)
camera.matrix, camera.select((0.5, 0.5))
print(loaded())
"""
    assert run_script(script, MUJOCO_GL=backend) == "[]\n"


@on_linux
def test_a_frame_needs_no_pyopengl(run_script: Callable[..., str]) -> None:
    script = f"""{_LOADED}
from limberjack.mujoco import Physics
Physics.from_xml_string({_MODEL}).render()
print(loaded())
"""
    loaded = run_script(script)
    assert "libEGL.so" in loaded
    assert "OpenGL." not in loaded.replace("libOpenGL.", "")


@pytest.mark.parametrize("backend", ["egl", "nonsense", None])
def test_environment_variables_are_unchanged(
    run_script: Callable[..., str], backend: str | None
) -> None:
    script = f"""
import os
before = dict(os.environ)
import limberjack.mujoco
print(dict(os.environ) == before)
try:
    limberjack.mujoco.Physics.from_xml_string({_MODEL}).render()
except RuntimeError:
    pass
print(dict(os.environ) == before)
"""
    assert run_script(script, MUJOCO_GL=backend) == "True\nTrue\n"


_STATEMENTS = [
    "from mujoco import GLContext",
    "from mujoco.gl_context import GLContext",
    "from mujoco.rendering.classic.gl_context import GLContext",
    "from mujoco.rendering.classic.renderer import GLContext",
    "from mujoco.gl_context import *",
    "import mujoco; GLContext = mujoco.GLContext",
    "import mujoco.gl_context; GLContext = mujoco.gl_context.GLContext",
]


@on_linux
def test_mujocos_context_class_exists_under_all_its_names(run_script: Callable[..., str]) -> None:
    script = f"""
import os
import limberjack.mujoco
for statement in {_STATEMENTS}:
    child = os.fork()  # so that no statement finds what another one has imported
    if not child:
        exec(statement)
        import mujoco.egl
        os._exit(0 if GLContext is mujoco.egl.GLContext is mujoco.GLContext else 1)
    if os.waitpid(child, 0)[1]:
        print(statement)
"""
    assert run_script(script, MUJOCO_GL="egl") == ""


def test_mujocos_renderer_works(run_script: Callable[..., str]) -> None:
    script = f"""
import limberjack.mujoco, mujoco
model = mujoco.MjModel.from_xml_string({_MODEL})
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 32, 32) as renderer:
    renderer.update_scene(data)
    print(renderer.render().any())
"""
    assert run_script(script) == "True\n"


def test_mujoco_reads_the_variable_when_its_context_is_asked_for(
    run_script: Callable[..., str],
) -> None:
    script = """
import os
import limberjack.mujoco, mujoco
try:
    mujoco.GLContext
except RuntimeError as error:
    print(error)
os.environ["MUJOCO_GL"] = "disable"
print(hasattr(mujoco, "GLContext"), hasattr(mujoco, "no_such_name"))
os.environ["MUJOCO_GL"] = "egl"
print(mujoco.GLContext.__module__)
"""
    printed = run_script(script, MUJOCO_GL="nonsense").splitlines()
    assert printed == [
        "invalid value for environment variable MUJOCO_GL: nonsense",
        "False False",
        "mujoco.egl",
    ]


def test_a_mujoco_imported_before_is_left_alone(run_script: Callable[..., str]) -> None:
    script = """
import mujoco
before = [dict(vars(m)) for m in (mujoco, mujoco.rendering.classic.gl_context)]
import limberjack.mujoco.official
after = [dict(vars(m)) for m in (mujoco, mujoco.rendering.classic.gl_context)]
print(limberjack.mujoco.official.mujoco is mujoco, "__getattr__" in vars(mujoco))
print(all(x[name] is y[name] for x, y in zip(before, after) for name in x))
"""
    assert run_script(script) == "True False\nTrue\n"


def test_every_official_name_exists(run_script: Callable[..., str]) -> None:
    names = "import mujoco; mujoco.GLContext; print(*sorted(vars(mujoco)))"
    normally = run_script(names)
    assert set(normally.split()) <= set(run_script(f"import limberjack.mujoco; {names}").split())


def test_an_older_mujoco_is_refused_with_the_versions(tmp_path: Path) -> None:
    older = tmp_path / "mujoco"
    older.mkdir()
    (older / "__init__.py").write_text("__version__ = '3.3.7'\n")
    code = "import limberjack.mujoco"
    paths = os.pathsep.join([str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])])
    result = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code],
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert result.returncode == 1
    message = result.stderr[result.stderr.index("ImportError: limberjack needs mujoco.batch") :]
    assert "mujoco 3.3.7 is installed" in message
    commands = [line.strip() for line in message.splitlines()]
    assert any(line.startswith("pip uninstall -y mujoco") for line in commands), message
    assert any(line.startswith("pip install ") and "mujoco" in line for line in commands), message
