"""Tests of limberjack.mujoco.camera, beside dm_control and alone.

How OpenGL is reached and lasts is tested in rendering/.
"""

import itertools
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Physics, wrapper
from limberjack.mujoco.camera import Camera, MovableCamera, Pose, TextOverlay, contexts, render

# Something of all that MuJoCo draws in its own way: textures, sky, haze, fog, a mesh, a height
# field, a reflection, shadows, transparency, sites, tendons, a light that moves, three cameras.
_FURNISHED = """
<mujoco>
  <visual>
    <global offheight="200" offwidth="300"/>
    <rgba fog=".2 .4 .6 1"/>
    <map fogstart="1" fogend="4"/>
    <quality shadowsize="512"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1=".4 .6 .8" rgb2="0 0 0"
        width="64" height="384"/>
    <texture name="grid" type="2d" builtin="checker" rgb1=".1 .2 .3" rgb2=".7 .8 .9"
        width="64" height="64" mark="edge" markrgb="1 0 0"/>
    <material name="floor" texture="grid" texrepeat="2 2" reflectance=".4"/>
    <material name="glass" rgba=".9 .3 .3 .4"/>
    <mesh name="tent" vertex="0 0 .4  .3 0 0  -.3 0 0  0 .3 0  0 -.3 0"/>
    <hfield name="hill" nrow="3" ncol="3" size=".4 .4 .3 .1" elevation="0 0 0 0 1 0 0 0 0"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="0 0 3" dir="0 0 -1" diffuse=".8 .8 .8"/>
    <geom name="floor" type="plane" size="0 0 .1" material="floor"/>
    <geom name="tent" type="mesh" mesh="tent" pos="-.6 .2 0" rgba=".2 .7 .2 1"/>
    <geom name="hill" type="hfield" hfield="hill" pos=".8 .6 .1" rgba=".5 .4 .2 1"/>
    <body name="arm" pos="0 0 .8">
      <joint name="hinge" axis="0 1 0"/>
      <geom name="arm" type="capsule" fromto="0 0 0 .4 0 0" size=".06" rgba=".8 .5 .1 1"/>
      <geom name="bulb" type="sphere" size=".15" pos=".5 0 0" material="glass"/>
      <site name="tip" pos=".7 0 0" size=".05" rgba="0 0 1 1"/>
      <light name="torch" pos=".4 0 .1" dir="0 0 -1" mode="track"/>
      <camera name="hand" pos=".2 -.6 .1" xyaxes="1 0 0 0 .3 1"/>
    </body>
    <site name="anchor" pos="0 .3 1.2" size=".03"/>
    <camera name="wall" pos="0 -3 1.2" xyaxes="1 0 0 0 .3 1" fovy="50"/>
    <camera name="ceiling" pos=".1 0 4"/>
  </worldbody>
  <tendon>
    <spatial name="string"><site site="anchor"/><site site="tip"/></spatial>
  </tendon>
</mujoco>
"""
_BARE = "<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>"
_SIZE = {"height": 96, "width": 128}
_KINDS: dict[str, dict[str, bool]] = {
    "colours": {},
    "depth": {"depth": True},
    "segmentation": {"segmentation": True},
}


def _furnished(package: Any = None) -> Any:
    """The furnished room in mid-motion, by our Physics or another package's."""
    physics = (package.Physics if package else Physics).from_xml_string(_FURNISHED)
    physics.step(20)
    return physics


@pytest.fixture
def twins(theirs: Callable[[str], ModuleType]) -> tuple[Any, Any]:
    return _furnished(), _furnished(theirs("mujoco"))


def _assert_same(ours: Any, theirs: Any) -> None:
    assert type(ours) is type(theirs)
    assert (ours.shape, ours.dtype) == (theirs.shape, theirs.dtype)
    np.testing.assert_array_equal(ours, theirs)


# Beside dm_control.


@pytest.mark.oracle
@pytest.mark.parametrize("camera_id", [-1, 0, "wall", np.int64(2)])
@pytest.mark.parametrize("kind", _KINDS)
def test_pictures_are_dm_controls(twins: tuple[Any, Any], kind: str, camera_id: Any) -> None:
    pictures = [p.render(**_SIZE, camera_id=camera_id, **_KINDS[kind]) for p in twins]
    _assert_same(*pictures)
    assert len(np.unique(pictures[0])) > 2


@pytest.mark.oracle
@pytest.mark.parametrize("kind", _KINDS)
@pytest.mark.parametrize(("domain", "task"), suite.BENCHMARKING)
def test_pictures_of_the_suite_are_dm_controls(
    theirs: Callable[[str], ModuleType], domain: str, task: str, kind: str
) -> None:
    envs = [s.load(domain, task, task_kwargs={"random": 3}) for s in (suite, theirs("suite"))]
    pictures = []
    for env in envs:
        env.reset()
        env.step(np.full(env.action_spec().shape, 0.5))
        pictures.append(env.physics.render(84, 84, camera_id=0, **_KINDS[kind]))
    _assert_same(*pictures)


@pytest.mark.oracle
@pytest.mark.parametrize(
    "flag", [name[6:].lower() for name in list(mujoco.mjtRndFlag.__members__)[:-1]]
)
def test_flag_overrides_are_dm_controls(twins: tuple[Any, Any], flag: str) -> None:
    for flags in ({flag: True}, {flag: False}):
        pictures = [p.render(**_SIZE, render_flag_overrides=dict(flags)) for p in twins]
        _assert_same(*pictures)
    number = mujoco.mjtRndFlag.__members__[f"mjRND_{flag.upper()}"]
    by_number = twins[0].render(**_SIZE, render_flag_overrides={number: False})
    _assert_same(by_number, pictures[0])


@pytest.mark.oracle
@pytest.mark.parametrize("style", ["normal", "shadow", "big"])
@pytest.mark.parametrize("position", ["top left", "top right", "bottom left", "bottom right"])
def test_overlays_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType], style: str, position: str
) -> None:
    texts = ("reward\ntime", "0.93\n1.25", style, position)
    overlays = [TextOverlay(*texts)], [theirs("mujoco").TextOverlay(*texts)]
    pictures = [p.render(**_SIZE, overlays=o) for p, o in zip(twins, overlays, strict=True)]
    _assert_same(*pictures)
    assert (pictures[0] != twins[0].render(**_SIZE)).any()


@pytest.mark.oracle
def test_scene_options_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType]
) -> None:
    for flag in ("mjVIS_TRANSPARENT", "mjVIS_CONTACTPOINT", "mjVIS_JOINT", "mjVIS_CONVEXHULL"):
        pictures = []
        for physics, options in zip(twins, (wrapper, theirs("mujoco.wrapper")), strict=True):
            option = options.MjvOption()
            option.flags[mujoco.mjtVisFlag.__members__[flag]] = 1
            option.frame = mujoco.mjtFrame.mjFRAME_BODY
            pictures.append(physics.render(**_SIZE, scene_option=option))
        _assert_same(*pictures)


@pytest.mark.oracle
@pytest.mark.parametrize("kind", _KINDS)
def test_what_a_callback_adds_is_drawn_as_by_dm_control(
    twins: tuple[Any, Any], kind: str
) -> None:
    pictures = [p.render(**_SIZE, scene_callback=_add_box, **_KINDS[kind]) for p in twins]
    _assert_same(*pictures)
    _assert_same(*[p.render(**_SIZE, **_KINDS[kind]) for p in twins])


@pytest.mark.oracle
@pytest.mark.parametrize("camera_id", [-1, 0, 1])
def test_cameras_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType], camera_id: int
) -> None:
    classes = (Camera, theirs("mujoco").Camera)
    ours, other = (
        camera(p, **_SIZE, camera_id=camera_id) for camera, p in zip(classes, twins, strict=True)
    )
    assert (ours.height, ours.width) == (other.height, other.width)
    for ours_part, their_part in zip(ours.matrices(), other.matrices(), strict=True):
        _assert_same(ours_part, their_part)
    _assert_same(ours.matrix, other.matrix)
    for point in itertools.product((0.1, 0.5, 0.9), repeat=2):
        mine, dm_controls = ours.select(point), other.select(point)
        assert mine._fields == dm_controls._fields
        assert mine[:4] == dm_controls[:4]
        np.testing.assert_array_equal(mine.world_position, dm_controls.world_position)
    for camera in (ours, other):
        camera.scene.flags[mujoco.mjtRndFlag.mjRND_WIREFRAME] = 1
        camera.option.flags[mujoco.mjtVisFlag.mjVIS_TENDON] = 0
    _assert_same(ours.render(), other.render())
    _assert_same(ours.render(segmentation=True), other.render(segmentation=True))


@pytest.mark.oracle
def test_movable_cameras_are_dm_controls(
    twins: tuple[Any, Any], theirs: Callable[[str], ModuleType]
) -> None:
    pictures = []
    for physics, camera_class in zip(
        twins, (MovableCamera, theirs("mujoco").MovableCamera), strict=True
    ):
        camera = camera_class(physics, **_SIZE)
        start = camera.get_pose()
        camera.set_pose(start.lookat + 0.1, start.distance * 1.5, 30.0, -25.0)
        moved = camera.get_pose()
        pictures.append((*start, *moved, camera.matrix, camera.render()))
    for ours, other in zip(*pictures, strict=True):
        np.testing.assert_array_equal(ours, other)


@pytest.mark.oracle
def test_models_drawn_in_turn_do_not_mix(theirs: Callable[[str], ModuleType]) -> None:
    other_room = _FURNISHED.replace('fogend="4"', 'fogend="9"').replace(".1 .2 .3", ".9 .2 .3")
    flags = {"fog": True}
    packages = (ours, theirs("mujoco")) if (ours := sys.modules["limberjack.mujoco"]) else ()
    rooms = [[p.Physics.from_xml_string(x) for x in (_FURNISHED, other_room)] for p in packages]
    for _ in range(2):
        for pair in zip(*rooms, strict=True):
            _assert_same(*[p.render(**_SIZE, render_flag_overrides=dict(flags)) for p in pair])


@pytest.mark.oracle
def test_a_texture_uploaded_is_drawn_as_by_dm_control(twins: tuple[Any, Any]) -> None:
    bystander = _furnished()
    before = bystander.render(**_SIZE)
    pictures = []
    for physics in twins:
        physics.render(**_SIZE)
        with physics.contexts.gl.make_current() as context:
            model = physics.model.ptr
            model.tex_data[:] = 255 - model.tex_data
            for texture in range(model.ntex):
                context.call(mujoco.mjr_uploadTexture, model, physics.contexts.mujoco.ptr, texture)
        pictures.append(physics.render(**_SIZE))
    _assert_same(*pictures)
    assert (pictures[0] != before).any()
    np.testing.assert_array_equal(bystander.render(**_SIZE), before)


# Alone.


def _add_box(physics: Any, scene: Any) -> None:
    """Puts a red box into the scene, and changes a flag."""
    scene.ngeom += 1
    mujoco.mjv_initGeom(
        scene.geoms[scene.ngeom - 1],
        mujoco.mjtGeom.mjGEOM_BOX.value,
        size=np.full(3, 0.2),
        pos=np.array([0.0, 0.0, 1.0]),
        mat=np.eye(3).flatten(),
        rgba=np.array([1, 0, 0, 1], np.float32),
    )
    scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = 0


@pytest.mark.parametrize("kind", _KINDS)
def test_a_picture_never_changes_and_is_nobody_elses(kind: str) -> None:
    physics = _furnished()
    camera = Camera(physics, **_SIZE)
    for draw in (lambda **k: physics.render(**_SIZE, **k), camera.render):
        first = draw(**_KINDS[kind])
        copy = first.copy()
        assert first.flags.c_contiguous
        assert first.flags.owndata
        assert first.flags.writeable
        physics.named.data.qpos["hinge"] += 1.0
        physics.forward()
        second = draw(**_KINDS[kind])
        np.testing.assert_array_equal(first, copy)
        assert (second != first).any()
        assert not np.shares_memory(first, second)


def test_the_callers_flag_overrides_are_left_alone() -> None:
    physics, flags = _furnished(), {"wireframe": True}
    physics.render(**_SIZE, render_flag_overrides=flags)
    assert flags == {"wireframe": True}
    empty: dict[str, bool] = {}
    physics.render(**_SIZE, segmentation=True, render_flag_overrides=empty)
    assert empty == {}


def test_nothing_of_a_picture_stays_for_the_next() -> None:
    physics = _furnished()
    plain = physics.render(**_SIZE)
    for other in (
        {"scene_callback": _add_box},
        {"render_flag_overrides": {"shadow": False}},
        {"segmentation": True},
        {"camera_id": 1},
        {"overlays": [TextOverlay("text")]},
    ):
        assert not np.array_equal(physics.render(**_SIZE, **other), plain)
        np.testing.assert_array_equal(physics.render(**_SIZE), plain)


def test_a_callback_comes_after_the_update_and_before_the_picture() -> None:
    physics = _furnished()
    seen = []

    def callback(*args: Any) -> None:
        seen.append((*args, args[1].ngeom))

    camera = Camera(physics, **_SIZE, scene_callback=callback)
    camera.render()
    assert seen == [(physics, camera.scene, camera.scene.ngeom)]
    assert camera.scene.ngeom > 5


def test_a_callback_may_render() -> None:
    physics = _furnished()
    expected = physics.render(**_SIZE)
    inner = []
    physics.render(**_SIZE, scene_callback=lambda p, _: inner.append(p.render(**_SIZE)))
    np.testing.assert_array_equal(inner[0], expected)


def test_a_callbacks_error_is_the_callers() -> None:
    physics = _furnished()
    expected = physics.render(**_SIZE)

    def fail(*_: Any) -> None:
        raise KeyError("its own")

    with pytest.raises(KeyError, match="its own"):
        physics.render(**_SIZE, scene_callback=fail)
    np.testing.assert_array_equal(physics.render(**_SIZE), expected)


def test_depth_is_metres_along_the_cameras_axis() -> None:
    physics = Physics.from_xml_string("""
        <mujoco><worldbody>
          <geom type="plane" size="2 2 .1"/><geom type="box" size=".1 .1 .1" pos="0 0 .1"/>
          <camera name="top" pos="0 0 3"/>
        </worldbody></mujoco>""")
    depth = physics.render(100, 100, camera_id="top", depth=True)
    assert (depth.dtype, depth.shape) == (np.float32, (100, 100))
    # The depth buffer's resolution at 3 m, with the near plane at 1 cm times the model's extent.
    np.testing.assert_allclose([depth.min(), depth.max()], [2.8, 3.0], atol=2e-3)


def test_segmentation_gives_numbers_and_types_and_a_background() -> None:
    physics = _furnished()
    seen = physics.render(**_SIZE, camera_id="wall", segmentation=True)
    assert (seen.dtype, seen.shape) == (np.int32, (96, 128, 2))
    pairs = {tuple(pair) for pair in seen.reshape(-1, 2)}
    assert (-1, -1) in pairs
    assert (physics.model.name2id("tent", "geom"), mujoco.mjtObj.mjOBJ_GEOM) in pairs
    assert (physics.model.name2id("tip", "site"), mujoco.mjtObj.mjOBJ_SITE) in pairs


def test_the_models_present_colours_and_lights_are_drawn() -> None:
    physics = _furnished()
    before = physics.render(**_SIZE)
    physics.named.model.geom_rgba["tent"] = [1, 0, 0, 1]
    assert not np.array_equal(physics.render(**_SIZE), before)
    np.testing.assert_array_equal(_furnished().render(**_SIZE), before)


def test_a_buffer_enlarged_after_the_first_picture_is_used() -> None:
    physics = _furnished()
    physics.render(**_SIZE)
    for side in (400, 500):
        physics.model.vis.global_.offheight = physics.model.vis.global_.offwidth = side
        larger = _FURNISHED.replace('offheight="200" offwidth="300"', f'offheight="{side}"')
        other = Physics.from_xml_string(larger)
        other.set_state(physics.get_state())
        other.forward()
        picture = physics.render(side, 300)
        np.testing.assert_array_equal(picture, other.render(side, 300))


def test_a_pose_is_a_copy() -> None:
    camera = MovableCamera(_furnished(), **_SIZE)
    pose = camera.get_pose()
    assert isinstance(pose, Pose)
    pose.lookat[:] = 7.0
    assert not (camera.get_pose().lookat == 7.0).any()


def test_cameras_work_where_rendering_does_not(run_script: Callable[..., str]) -> None:
    script = f"""
from limberjack.mujoco import Camera, Physics
physics = Physics.from_xml_string({_BARE!r})
camera = Camera(physics)
print(camera.matrix.shape, camera.select((0.5, 0.5)).geom, camera.scene.ngeom)
"""
    assert run_script(script, MUJOCO_GL="disable") == "(3, 4) 0 1\n"


# Bad input.


@pytest.mark.parametrize("size", [0, -1, 10_000, 84.0, 0.5, "84", None, float("nan")])
@pytest.mark.parametrize("side", ["height", "width"])
def test_a_size_that_cannot_be_is_refused(side: str, size: Any) -> None:
    physics = _furnished()
    with pytest.raises(ValueError, match=side):
        physics.render(**(_SIZE | {side: size}))
    with pytest.raises(ValueError, match=side):
        Camera(physics, **(_SIZE | {side: size}))


def test_a_size_beyond_the_buffer_is_refused_with_the_remedy() -> None:
    with pytest.raises(ValueError, match='301 > 300.*<global offwidth="301"/>'):
        _furnished().render(100, 301)


@pytest.mark.parametrize("camera_id", [-2, 3, 10**6])
def test_a_camera_number_out_of_range_is_refused(camera_id: int) -> None:
    with pytest.raises(ValueError, match=f"camera_id is {camera_id}.* 3 cameras"):
        _furnished().render(camera_id=camera_id)


def test_an_unknown_camera_is_refused_with_a_suggestion_and_the_list() -> None:
    with pytest.raises(wrapper.Error, match="'wal'.*'wall'.*hand, wall, ceiling"):
        _furnished().render(camera_id="wal")


@pytest.mark.parametrize(
    ("kwargs", "word"),
    [
        ({"depth": True, "segmentation": True}, "depth"),
        ({"depth": True, "overlays": [TextOverlay()]}, "overlays"),
        ({"segmentation": True, "overlays": [TextOverlay()]}, "overlays"),
        ({"depth": True, "render_flag_overrides": {"fog": True}}, "render_flag_overrides"),
        ({"segmentation": True, "render_flag_overrides": {"fog": True}}, "render_flag_overrides"),
        ({"render_flag_overrides": {"wirefame": True}}, "wirefame"),
    ],
)
def test_what_cannot_be_combined_is_refused(kwargs: dict[str, Any], word: str) -> None:
    physics = _furnished()
    expected = physics.render(**_SIZE)
    for draw in (lambda **k: render(physics, **_SIZE, **k), Camera(physics, **_SIZE).render):
        with pytest.raises(ValueError, match=word):
            draw(**kwargs)
        np.testing.assert_array_equal(draw(), expected)


def test_an_unknown_style_or_position_of_text_is_refused() -> None:
    with pytest.raises(ValueError, match="style is 'bigg'.*Did you mean 'big'"):
        TextOverlay(style="bigg")
    with pytest.raises(ValueError, match="position is 'centre'"):
        TextOverlay(position="centre")


def test_contexts_run_functions_where_opengl_is() -> None:
    physics = _furnished()
    with contexts(physics).gl.make_current() as context:
        assert context.call(lambda a, b: a + b, 1, b=2) == 3
        with pytest.raises(ZeroDivisionError):
            context.call(lambda: 1 / 0)
    first = contexts(physics).mujoco.ptr
    assert (first.offHeight, first.offWidth) == (200, 300)
    assert physics.contexts.mujoco.ptr is first
