"""Pictures and cameras of limberjack.mujoco.camera equal dm_control's, compared live."""

import itertools
from collections.abc import Callable
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics, wrapper
from limberjack.mujoco.camera import Camera, MovableCamera, TextOverlay
from tests.representatives import PAIRS

from .furnished import FURNISHED, INFINITE, KINDS, SIZE, add_box, furnished

pytestmark = pytest.mark.oracle


@pytest.fixture(scope="module")
def twins(theirs: Callable[[str], ModuleType]) -> tuple[Any, Any]:
    """One pair for all tests: making the contexts takes longer than drawing ten pictures."""
    return furnished(), furnished(theirs("mujoco"))


def _assert_same(ours: Any, theirs: Any) -> None:
    assert type(ours) is type(theirs)
    assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("camera_id", [-1, 0, "wall", np.int64(2)])
@pytest.mark.parametrize("kind", KINDS)
def test_pictures_are_dm_controls(twins: tuple[Any, Any], kind: str, camera_id: Any) -> None:
    pictures = [p.render(**SIZE, camera_id=camera_id, **KINDS[kind]) for p in twins]
    _assert_same(*pictures)
    assert len(np.unique(pictures[0])) > 2


def test_pictures_in_any_order_are_dm_controls(theirs: Callable[[str], ModuleType]) -> None:
    # An infinite plane is drawn about the point where its scene's camera was before.
    twins = furnished(xml=INFINITE), furnished(theirs("mujoco"), INFINITE)
    random = np.random.RandomState(0)
    for _ in range(20):
        camera_id, kind = random.randint(-1, 3), random.choice(list(KINDS))
        size = {"height": random.randint(1, 200), "width": random.randint(1, 300)}
        _assert_same(*[p.render(**size, camera_id=camera_id, **KINDS[kind]) for p in twins])
        for physics in twins:
            physics.step(5)


# Not the dog, whose meshes are not part of this package.
@pytest.mark.parametrize(("domain", "task"), [one for one in PAIRS if one.values[0] != "dog"])
def test_pictures_of_the_suite_are_dm_controls(
    theirs: Callable[[str], ModuleType], domain: str, task: str
) -> None:
    envs = [s.load(domain, task, task_kwargs={"random": 3}) for s in (suite, theirs("suite"))]
    for env in envs:
        env.reset()
        env.step(np.full(env.action_spec().shape, 0.5))
    for kwargs in KINDS.values():
        _assert_same(*[env.physics.render(84, 84, camera_id=0, **kwargs) for env in envs])


# Without the number of flags; and without the flag for depth, for which MuJoCo 4.0 draws memory
# that it has not written: its buffer has several samples a pixel, and OpenGL does not read those.
_FLAGS = sorted(
    name.removeprefix("mjRND_").lower()
    for name in set(mujoco.mjtRndFlag.__members__) - {"mjNRNDFLAG", "mjRND_DEPTH"}
)


@pytest.mark.parametrize("flag", _FLAGS)
def test_flag_overrides_are_dm_controls(twins: tuple[Any, Any], flag: str) -> None:
    for flags in ({flag: True}, {flag: False}):
        pictures = [p.render(**SIZE, render_flag_overrides=dict(flags)) for p in twins]
        _assert_same(*pictures)
    number = mujoco.mjtRndFlag.__members__[f"mjRND_{flag.upper()}"]
    by_number = twins[0].render(**SIZE, render_flag_overrides={number: False})
    _assert_same(by_number, pictures[0])


@pytest.mark.parametrize("style", ["normal", "shadow", "big"])
@pytest.mark.parametrize("position", ["top left", "top right", "bottom left", "bottom right"])
def test_overlays_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType], style: str, position: str
) -> None:
    texts = ("reward\ntime", "0.93\n1.25", style, position)
    overlays = [TextOverlay(*texts)], [theirs("mujoco").TextOverlay(*texts)]
    pictures = [p.render(**SIZE, overlays=o) for p, o in zip(twins, overlays, strict=True)]
    _assert_same(*pictures)
    assert (pictures[0] != twins[0].render(**SIZE)).any()


def test_scene_options_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType]
) -> None:
    for flag in ("mjVIS_TRANSPARENT", "mjVIS_CONTACTPOINT", "mjVIS_JOINT", "mjVIS_CONVEXHULL"):
        pictures = []
        for physics, options in zip(twins, (wrapper, theirs("mujoco.wrapper")), strict=True):
            option = options.MjvOption()
            option.flags[mujoco.mjtVisFlag.__members__[flag]] = 1
            option.frame = mujoco.mjtFrame.mjFRAME_BODY
            pictures.append(physics.render(**SIZE, scene_option=option))
        _assert_same(*pictures)


@pytest.mark.parametrize("kind", KINDS)
def test_geoms_added_by_a_callback_are_dm_controls(twins: tuple[Any, Any], kind: str) -> None:
    pictures = [p.render(**SIZE, scene_callback=add_box, **KINDS[kind]) for p in twins]
    _assert_same(*pictures)
    _assert_same(*[p.render(**SIZE, **KINDS[kind]) for p in twins])


@pytest.mark.parametrize("camera_id", [-1, 0, 1])
def test_cameras_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType], camera_id: int
) -> None:
    classes = (Camera, theirs("mujoco").Camera)
    ours, other = (
        camera(p, **SIZE, camera_id=camera_id) for camera, p in zip(classes, twins, strict=True)
    )
    assert (ours.height, ours.width) == (other.height, other.width)
    for ours_part, their_part in zip(ours.matrices(), other.matrices(), strict=True):
        _assert_same(ours_part, their_part)
    _assert_same(ours.matrix, other.matrix)
    for point in itertools.product((0.1, 0.5, 0.9), (0.1, 0.5, 0.9)):
        mine, dm_controls = ours.select(point), other.select(point)
        assert mine._fields == dm_controls._fields
        assert mine[:4] == dm_controls[:4]
        np.testing.assert_array_equal(mine.world_position, dm_controls.world_position)
    for camera in (ours, other):
        camera.scene.flags[mujoco.mjtRndFlag.mjRND_WIREFRAME] = 1
        camera.option.flags[mujoco.mjtVisFlag.mjVIS_TENDON] = 0
    _assert_same(ours.render(), other.render())
    _assert_same(ours.render(segmentation=True), other.render(segmentation=True))


def test_movable_cameras_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType]
) -> None:
    pictures = []
    for physics, camera_class in zip(
        twins, (MovableCamera, theirs("mujoco").MovableCamera), strict=True
    ):
        camera = camera_class(physics, **SIZE)
        lookat, distance, *angles = camera.get_pose()
        camera.set_pose(lookat + 0.1, distance * 1.5, 30.0, -25.0)
        pictures.append((distance, angles, *camera.get_pose(), camera.matrix, camera.render()))
    for ours, other in zip(*pictures, strict=True):
        np.testing.assert_array_equal(ours, other)


def test_models_drawn_in_turn_do_not_mix(theirs: Callable[[str], ModuleType]) -> None:
    other_room = FURNISHED.replace('fogend="4"', 'fogend="9"').replace(".1 .2 .3", ".9 .2 .3")
    flags = {"fog": True}
    classes = (Physics, theirs("mujoco").Physics)
    rooms = [[c.from_xml_string(xml) for xml in (FURNISHED, other_room)] for c in classes]
    for _ in range(2):
        for pair in zip(*rooms, strict=True):
            _assert_same(*[p.render(**SIZE, render_flag_overrides=dict(flags)) for p in pair])


def test_a_texture_uploaded_is_drawn_as_by_dm_control(
    theirs: Callable[[str], ModuleType],
) -> None:
    twins = furnished(), furnished(theirs("mujoco"))
    bystander = furnished()
    before = bystander.render(**SIZE)
    pictures = []
    for physics in twins:
        physics.render(**SIZE)
        with physics.contexts.gl.make_current() as context:
            model = physics.model.ptr
            model.tex_data[:] = 255 - model.tex_data
            for texture in range(model.ntex):
                context.call(mujoco.mjr_uploadTexture, model, physics.contexts.mujoco.ptr, texture)
        pictures.append(physics.render(**SIZE))
    _assert_same(*pictures)
    assert (pictures[0] != before).any()
    np.testing.assert_array_equal(bystander.render(**SIZE), before)
