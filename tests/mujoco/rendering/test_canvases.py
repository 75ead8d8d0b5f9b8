"""Tests of limberjack.mujoco.rendering.canvases: sharing, freeing, memory."""

import copy
import sys
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Physics, wrapper
from limberjack.mujoco.rendering import call, canvases, thread

_MODEL = """
<mujoco>
  <visual><quality shadowsize="{shadow}"/><global offwidth="64" offheight="64"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1="{colour}" width="8" height="8"/>
  </asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="ball" size=".3" rgba=".5 .6 .7 1"/>
    <body name="mover" mocap="true"><geom name="box" type="box" size=".1 .1 .1"/></body>
  </worldbody>
</mujoco>
"""


def _physics(colour: str = ".1 .2 .3", shadow: int = 128) -> Physics:
    return Physics.from_xml_string(_MODEL.format(colour=colour, shadow=shadow))


def _context(physics: Physics) -> int:
    """Identifies the MuJoCo context that draws a physics, by buffer and context object."""
    return call(physics.model._official, id)


def test_models_with_equal_resources_share_a_canvas() -> None:
    first, second = _physics(), _physics()
    second.named.model.geom_rgba["ball"] = [1, 0, 0, 1]
    second.named.model.body_pos["mover"] = [0.3, 0, 0.3]
    second.forward()
    frames = [p.render(48, 48) for p in (first, second, first)]
    assert _context(first) == _context(second)
    assert (frames[0] != frames[1]).any()
    np.testing.assert_array_equal(frames[0], frames[2])


def test_models_with_different_resources_do_not_share_a_canvas(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # All are kept: a later one might have the id of one that is gone.
    monkeypatch.setattr(canvases, "_MOST_SHARED", 8)
    others = [_physics(colour=".9 0 0"), _physics(shadow=256), _physics()]
    others[-1].model.stat.extent = 7.0  # by which fog begins, which a context has from its creation
    assert len({_context(p) for p in (_physics(), *others)}) == 4


@pytest.mark.parametrize("size", [(48, 96), (96, 48)])
def test_a_model_whose_buffer_was_enlarged_is_drawn_whole(size: tuple[int, int]) -> None:
    enlarged, fresh = _physics(), _physics()
    enlarged.render(48, 48)
    for physics in (enlarged, fresh):
        whole = physics.model.vis.global_
        whole.offheight, whole.offwidth = size
    np.testing.assert_array_equal(enlarged.render(*size), fresh.render(*size))


def test_models_that_share_a_canvas_are_compared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[mujoco.MjModel] = []
    fingerprint = canvases._fingerprint

    def counted(model: mujoco.MjModel, is_changing: bool) -> bytes:
        compared.append(model)
        return fingerprint(model, is_changing)

    monkeypatch.setattr(canvases, "_fingerprint", counted)
    # Their geoms have other numbers.
    plane, ball = '<geom type="plane" size="1 1 1"/>', '<geom size=".1"/>'
    both = [
        Physics.from_xml_string(f"<mujoco><worldbody>{geoms}</worldbody></mujoco>")
        for geoms in (plane + ball, ball + plane)
    ]
    for physics in (*both, *both):
        physics.render(48, 48)
    assert compared == [physics.model._official for physics in both]


@pytest.mark.parametrize("is_private", [False, True])
def test_a_geom_that_becomes_a_plane_or_stops_being_one_is_drawn(is_private: bool) -> None:
    physics, other = _physics(), _physics()
    if is_private:
        physics.contexts.mujoco.ptr  # noqa: B018
    before = physics.render(48, 48)
    pictures = []
    for kind in (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_SPHERE):
        physics.named.model.geom_type["ball"] = kind
        pictures.append(physics.render(48, 48))
        fresh = Physics.from_model(wrapper.MjModel(copy.copy(physics.model.ptr)))
        np.testing.assert_array_equal(pictures[-1], fresh.render(48, 48))
    assert (pictures[0] != before).any()
    np.testing.assert_array_equal(pictures[1], before)
    np.testing.assert_array_equal(other.render(48, 48), before)


def test_more_models_than_are_kept_can_be_drawn_in_turn() -> None:
    rooms = [_physics(f".{k} .5 .5") for k in range(10, 14)]
    first = [p.render(48, 48) for p in rooms]
    assert len({frame.tobytes() for frame in first}) == len(rooms)
    kept = thread._process._threads[0].canvases._canvases
    assert sum(isinstance(key, canvases._Shared) for key in kept) == canvases._MOST_SHARED
    for room, frame in zip(rooms, first, strict=True):
        np.testing.assert_array_equal(room.render(48, 48), frame)


def test_after_a_nested_picture_of_another_model_the_outer_context_is_current() -> None:
    first, second = _physics(), _physics(colour=".9 0 0")
    area, pixels = mujoco.MjrRect(0, 0, 48, 48), np.zeros((48, 48, 3), np.uint8)

    def fill_and_read(context: mujoco.MjrContext) -> None:
        mujoco.mjr_rectangle(area, 0, 1, 0, 1)
        second.render(48, 48)
        mujoco.mjr_readPixels(pixels, None, area, context)

    call(first.model._official, fill_and_read)
    assert (pixels == [0, 255, 0]).all()


def test_changes_to_a_private_context_affect_no_other() -> None:
    mine, others = _physics(), _physics()
    assert _context(mine) == _context(others)
    shared = mine.model._official
    assert mine.contexts.mujoco.ptr.offWidth == 64
    assert mine.model._official is shared
    assert _context(mine) != _context(others)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(
    ("kind", "count"), [("the same", 100), ("different", 8), ("with contexts of their own", 8)]
)
def test_memory_is_flat_over_fresh_physics(
    run_script: Callable[..., str], kind: str, count: int
) -> None:
    script = f"""
from limberjack.mujoco import Camera, Physics
from limberjack.mujoco.rendering import canvases
canvases._MOST_SHARED = 2
model = {_MODEL!r}
def megabytes():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6
def draw(k):
    colour = f"{{(k % 250) / 255 if {kind!r} == 'different' else 0}} .2 .3"
    physics = Physics.from_xml_string(model.format(colour=colour, shadow=1024))
    if {kind!r} == 'with contexts of their own':
        physics.contexts.mujoco.ptr
    physics.render(48, 48)
    physics.render(48, 48, depth=True)
    Camera(physics, 32, 32).render(segmentation=True)
for k in range(4):
    draw(k)
before = megabytes()
for k in range(4, 4 + {count}):
    draw(k)
print(megabytes() - before)
"""
    # Each context holds a shadow map of 4 MB and more; what is left is the allocators' noise.
    assert float(run_script(script)) < 20.0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_is_flat_over_a_hundred_thousand_pictures_of_a_thousand_environments(
    run_script: Callable[..., str],
) -> None:
    script = """
import ctypes, gc
from limberjack import suite
def megabytes():
    gc.collect()
    # What the allocator keeps for later is given back where the C library can.
    getattr(ctypes.CDLL(None), "malloc_trim", int)(0)
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6
def draw(k):
    domain, task = suite.ALL_TASKS[k % len(suite.ALL_TASKS)]
    environment = suite.load(domain, task, task_kwargs={"random": k})
    environment.reset()
    for _ in range(100):
        environment.physics.render(8, 8, camera_id=0, quality="fast")
    environment.close()
for k in range(30):
    draw(k)
before = megabytes()
for k in range(1000):
    draw(k)
print(megabytes() - before)
"""
    # A kilobyte kept of each picture is 100 MB, and a model kept of each environment 12 GB. A model
    # or two come and go.
    assert float(run_script(script, longest=3600.0)) < 40.0
