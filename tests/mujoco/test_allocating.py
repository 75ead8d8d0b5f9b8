"""A lack of memory is a MemoryError that names the bytes."""

import sys
from collections.abc import Callable

import mujoco
import pytest

from limberjack.mujoco.allocating import allocating, copy_of, data_of

_SCRIPT = """
import copy
import resource
from pathlib import Path

import numpy as np
import mujoco
from limberjack import suite
from limberjack.mujoco import Physics, wrapper
from limberjack.mujoco.allocating import copy_of, data_of

FREE = resource.RLIM_INFINITY
LARGE = '<texture name="sky" type="skybox" builtin="flat" width="4000" height="24000"/>'
XML = '<mujoco>{}<worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>'
env = suite.load("humanoid", "walk", {"random": 0})
physics = env.physics
model, saved = physics.model, physics.model.to_bytes()
own = wrapper.MjModel.from_byte_string(saved)


def attempts():
    yield "own", lambda: model.copy().ptr
    yield "copy", lambda: physics.copy()
    yield "model", lambda: own.copy()
    yield "data", lambda: wrapper.MjData(own)
    yield "bytes", lambda: wrapper.MjModel.from_byte_string(saved)
    yield "text", lambda: Physics.from_xml_string(XML.format("<asset>" + LARGE + "</asset>"))
    yield "batch", lambda: physics.replicate(100_000, 1)
    yield "scene", lambda: wrapper.MjvScene(model, 10_000_000)
    yield "light", lambda: own.without_textures()
    yield "deepcopy", lambda: copy.deepcopy(env)


for name, attempt in attempts():
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + 2**20, FREE))
    ballast, size = [], 2**24
    while size >= 2**16:  # fills what was freed earlier
        try:
            ballast.append(bytearray(size))
        except MemoryError:
            size //= 2
    del ballast[-3:]
    found = "nothing"
    try:
        attempt()
    except Exception as error:
        found = type(error).__name__, str(error)
    del ballast
    resource.setrlimit(resource.RLIMIT_AS, (FREE, FREE))
    print(name, *found)
env.reset()
env.step(np.zeros(21))
"""
_ATTEMPTS = [
    *("own", "copy", "model", "data", "bytes"),
    *("text", "batch", "scene", "light", "deepcopy"),
]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc, and needs RLIMIT_AS")
def test_a_lack_of_memory_names_what_lacks_it_and_the_bytes(run_script: Callable[..., str]) -> None:
    lines = run_script(_SCRIPT).splitlines()
    assert [line.split()[0] for line in lines] == _ATTEMPTS
    for line in lines:
        assert line.split()[1] == "MemoryError", line
        assert "bytes" in line or "MiB" in line, line  # the latter is NumPy's message


@pytest.mark.parametrize(
    "error",
    [
        mujoco.FatalError("Could not allocate memory"),
        ValueError("Error: engine error: Could not allocate memory"),
        RuntimeError("Caught an unknown exception!"),
        MemoryError("std::bad_alloc"),
    ],
)
def test_every_message_about_memory_becomes_one(error: Exception) -> None:
    message = r"no memory for a scene, 4096 bytes or more"
    with pytest.raises(MemoryError, match=message), allocating("a scene", 4096):
        raise error


def test_other_errors_stay_as_they_are() -> None:
    for error in (ValueError("no such joint"), mujoco.FatalError("unknown"), TypeError("memory")):
        with pytest.raises(type(error)) as caught, allocating("a scene", 4096):
            raise error
        assert caught.value is error


def test_copies_and_data_are_mujocos() -> None:
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data = data_of(copy_of(model))
    data.time = 3.0
    assert data_of(model, data).time == 3.0
    assert data.model is not model
