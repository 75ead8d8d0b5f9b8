"""Tests of limberjack.mujoco.camera.

Comparisons with dm_control are in test_camera_beside_dm_control.py, tests of OpenGL in rendering/.
"""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Physics, wrapper
from limberjack.mujoco.camera import (
    FREE_CAMERA,
    Camera,
    MovableCamera,
    Pose,
    RenderingError,
    TextOverlay,
    check_names,
    checked_size,
    picture_spec,
    render,
    view_of,
)

from .furnished import FURNISHED, INFINITE, KINDS, SIZE, add_box, furnished

_BARE = "<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>"


@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_is_a_fresh_array_that_never_changes(kind: str) -> None:
    physics = furnished()
    camera = Camera(physics, **SIZE)
    for draw in (lambda **k: physics.render(**SIZE, **k), camera.render):
        first = draw(**KINDS[kind])
        copy = first.copy()
        assert first.flags.c_contiguous
        assert first.flags.owndata
        assert first.flags.writeable
        physics.named.data.qpos["hinge"] += 1.0
        physics.forward()
        second = draw(**KINDS[kind])
        np.testing.assert_array_equal(first, copy)
        assert (second != first).any()
        assert not np.shares_memory(first, second)


def test_the_callers_flag_overrides_are_left_alone() -> None:
    physics, flags = furnished(), {"wireframe": True}
    physics.render(**SIZE, render_flag_overrides=flags)
    assert flags == {"wireframe": True}
    empty: dict[str, bool] = {}
    physics.render(**SIZE, segmentation=True, render_flag_overrides=empty)
    assert empty == {}


def test_nothing_of_a_picture_stays_for_the_next() -> None:
    physics = furnished()
    plain = physics.render(**SIZE)
    for other in (
        {"scene_callback": add_box},
        {"render_flag_overrides": {"shadow": False}},
        {"segmentation": True},
        {"camera_id": 1},
        {"overlays": [TextOverlay("text")]},
    ):
        assert not np.array_equal(physics.render(**SIZE, **other), plain)
        np.testing.assert_array_equal(physics.render(**SIZE), plain)


def test_a_callback_comes_after_the_update_and_before_the_picture() -> None:
    physics = furnished()
    seen = []

    def callback(*args: Any) -> None:
        seen.append((*args, args[1].ngeom))

    camera = Camera(physics, **SIZE, scene_callback=callback)
    camera.render()
    assert seen == [(physics, camera.scene, camera.scene.ngeom)]
    assert camera.scene.ngeom > 5


def test_a_callback_may_render() -> None:
    physics = furnished()
    expected = physics.render(**SIZE)
    inner = []
    physics.render(**SIZE, scene_callback=lambda p, _: inner.append(p.render(**SIZE)))
    np.testing.assert_array_equal(inner[0], expected)


def test_a_callbacks_error_is_the_callers() -> None:
    physics = furnished()
    expected = physics.render(**SIZE)

    def fail(*_: Any) -> None:
        raise KeyError("its own")

    with pytest.raises(KeyError, match="its own"):
        physics.render(**SIZE, scene_callback=fail)
    np.testing.assert_array_equal(physics.render(**SIZE), expected)


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
    physics = furnished()
    seen = physics.render(**SIZE, camera_id="wall", segmentation=True)
    assert (seen.dtype, seen.shape) == (np.int32, (96, 128, 2))
    pairs = {tuple(pair) for pair in seen.reshape(-1, 2)}
    assert (-1, -1) in pairs
    assert (physics.model.name2id("tent", "geom"), mujoco.mjtObj.mjOBJ_GEOM) in pairs
    assert (physics.model.name2id("tip", "site"), mujoco.mjtObj.mjOBJ_SITE) in pairs


def test_a_geom_added_without_a_number_is_background() -> None:
    def add(physics: Any, scene: Any) -> None:
        add_box(physics, scene)
        scene.geoms[scene.ngeom - 1].segid = 70_000  # As memory may hold it.

    physics = furnished()
    seen = physics.render(**SIZE, segmentation=True, scene_callback=add)
    assert (seen == -1).all(axis=-1).sum() > 10


def test_the_models_present_colours_and_lights_are_drawn() -> None:
    physics = furnished()
    before = physics.render(**SIZE)
    physics.named.model.geom_rgba["tent"] = [1, 0, 0, 1]
    assert not np.array_equal(physics.render(**SIZE), before)
    np.testing.assert_array_equal(furnished().render(**SIZE), before)


def test_a_buffer_enlarged_after_the_first_picture_is_used() -> None:
    physics = furnished()
    physics.render(**SIZE)
    for side in (400, 500):
        physics.model.vis.global_.offheight = physics.model.vis.global_.offwidth = side
        larger = FURNISHED.replace('offheight="200" offwidth="300"', f'offheight="{side}"')
        other = Physics.from_xml_string(larger)
        other.set_state(physics.get_state())
        other.forward()
        picture = physics.render(side, 300)
        np.testing.assert_array_equal(picture, other.render(side, 300))


def test_a_pose_is_a_copy() -> None:
    camera = MovableCamera(furnished(), **SIZE)
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


def test_fast_is_without_shadows_reflections_and_sky_and_the_default_with_them() -> None:
    physics = furnished()
    off = {"shadow": False, "reflection": False, "skybox": False}
    for camera_id in ("wall", "hand"):
        full = physics.render(**SIZE, camera_id=camera_id)
        fast = physics.render(**SIZE, camera_id=camera_id, quality="fast")
        expected = physics.render(**SIZE, camera_id=camera_id, render_flag_overrides=off)
        np.testing.assert_array_equal(fast, expected)
        assert (fast != full).any()
        np.testing.assert_array_equal(Camera(physics, **SIZE, camera_id=camera_id).render(), full)
        np.testing.assert_array_equal(
            Camera(physics, **SIZE, camera_id=camera_id).render(quality="fast"), fast
        )
        again = physics.render(**SIZE, camera_id=camera_id, quality="full")
        np.testing.assert_array_equal(again, full)


def test_a_fast_picture_has_a_black_background() -> None:
    physics = furnished(xml=INFINITE)
    seen = physics.render(**SIZE, camera_id="wall", segmentation=True, quality="fast")
    np.testing.assert_array_equal(seen, physics.render(**SIZE, camera_id="wall", segmentation=True))
    fast = physics.render(**SIZE, camera_id="wall", quality="fast")
    # One pixel from any object, as edges are smoothed.
    background = seen[..., 0] == -1
    inner = background.copy()
    inner[1:-1, 1:-1] &= background[:-2, 1:-1] & background[2:, 1:-1]
    inner[1:-1, 1:-1] &= background[1:-1, :-2] & background[1:-1, 2:]
    assert inner.sum() > 100
    assert (fast[inner] == 0).all()


def test_flag_overrides_come_before_the_quality() -> None:
    physics = furnished()
    kwargs: dict[str, Any] = {"quality": "fast", "camera_id": "wall"}
    with_sky = physics.render(**SIZE, **kwargs, render_flag_overrides={"skybox": True})
    assert (with_sky != physics.render(**SIZE, **kwargs)).any()
    assert (with_sky != physics.render(**SIZE, camera_id="wall")).any()


@pytest.mark.parametrize("quality", ["fats", "", None, 1, ["fast"]])
def test_an_unknown_quality_is_refused(quality: Any) -> None:
    physics = furnished()
    for draw in (lambda **k: physics.render(**SIZE, **k), Camera(physics, **SIZE).render):
        with pytest.raises(ValueError, match="; expected 'full' or 'fast'") as caught:
            draw(quality=quality)
        assert ("Did you mean 'fast'?" in str(caught.value)) is (quality == "fats")


def test_a_buffer_that_opengl_cannot_make_is_an_error_and_others_draw_on() -> None:
    physics, good = furnished(), furnished()
    expected = good.render(**SIZE)
    physics.model.vis.global_.offheight = physics.model.vis.global_.offwidth = 10**6
    with pytest.raises(RenderingError, match=r"cannot draw into .* 1000000 by 1000000 pixels"):
        physics.render(10**6, 10**6)
    np.testing.assert_array_equal(good.render(**SIZE), expected)


@pytest.mark.parametrize("size", [0, -1, 10_000, 84.0, 0.5, "84", None, float("nan")])
@pytest.mark.parametrize("side", ["height", "width"])
def test_a_size_that_cannot_be_is_refused(side: str, size: Any) -> None:
    physics = furnished()
    with pytest.raises(ValueError, match=side):
        physics.render(**(SIZE | {side: size}))
    with pytest.raises(ValueError, match=side):
        Camera(physics, **(SIZE | {side: size}))


def test_a_size_beyond_the_buffer_is_refused_with_the_remedy() -> None:
    with pytest.raises(ValueError, match=r'301 > 300.*<global offwidth="301"/>'):
        furnished().render(100, 301)


@pytest.mark.parametrize("camera_id", [-2, 3, 10**6])
def test_a_camera_number_out_of_range_is_refused(camera_id: int) -> None:
    with pytest.raises(ValueError, match=f"camera_id is {camera_id}.* 3 cameras"):
        furnished().render(**SIZE, camera_id=camera_id)
    with pytest.raises(ValueError, match=f"camera_id is {camera_id}.* 3 cameras"):
        Camera(furnished(), **SIZE, camera_id=camera_id)


def test_an_unknown_camera_is_refused_with_a_suggestion_and_the_list() -> None:
    with pytest.raises(wrapper.Error, match=r"'wal'.*Did you mean 'wall'\?.*ceiling"):
        furnished().render(**SIZE, camera_id="wal")
    with pytest.raises(wrapper.Error, match=r"Did you mean 'wall'\?"):
        Camera(furnished(), **SIZE, camera_id="wal")


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
def test_incompatible_arguments_are_refused(kwargs: dict[str, Any], word: str) -> None:
    physics = furnished()
    expected = physics.render(**SIZE)
    for draw in (lambda **k: render(physics, **SIZE, **k), Camera(physics, **SIZE).render):
        with pytest.raises(ValueError, match=word):
            draw(**kwargs)
    np.testing.assert_array_equal(physics.render(**SIZE), expected)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [{}, SIZE], ids=["the size by default", "another size"])
def test_the_spec_is_the_shape_and_the_type_of_the_picture(kind: str, size: dict[str, Any]) -> None:
    physics = furnished()
    if not size:
        physics.model.vis.global_.offheight = 240
        physics.model.vis.global_.offwidth = 320
    given = {**size, **KINDS[kind]}
    picture = render(physics, **given)
    assert picture_spec(physics, given) == (picture.shape, picture.dtype)
    np.testing.assert_array_equal(picture, physics.render(**given))


def test_a_spec_is_known_without_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    physics = furnished()
    monkeypatch.setattr("limberjack.mujoco.camera.Camera.render", None)  # so that it would fail
    assert picture_spec(physics, SIZE) == ((96, 128, 3), np.dtype(np.uint8))
    assert picture_spec(physics, {**SIZE, "depth": True}) == ((96, 128), np.dtype(np.float32))
    segmented = picture_spec(physics, {**SIZE, "segmentation": True})
    assert segmented == ((96, 128, 2), np.dtype(np.int32))


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"camera_id": "wal"}, ValueError, "wal"),
        ({"camera_id": 3}, ValueError, "camera"),
        ({"height": 201}, ValueError, "201"),
        ({"width": 0}, ValueError, "width"),
        ({"quality": "fsat"}, ValueError, "Did you mean 'fast'"),
        ({"depth": True, "segmentation": True}, ValueError, "cannot both be true"),
        ({"hieght": 20}, TypeError, r"unexpected keyword argument 'hieght'.*'height'"),
    ],
)
def test_a_spec_is_refused_where_a_picture_would_be(
    given: dict[str, Any], error: type[Exception], message: str
) -> None:
    physics = furnished()
    with pytest.raises(error, match=message):
        picture_spec(physics, {**SIZE, **given})


def test_keywords_are_those_of_render_and_a_wrong_one_is_answered_with_all_of_them() -> None:
    check_names({})
    check_names(dict.fromkeys(("height", "camera_id", "scene_callback", "quality")))
    with pytest.raises(TypeError, match=r"'physics'.* It takes: height, width, camera_id, over"):
        check_names({"height": 1, "physics": None})


_TWO_CAMERAS = """
<mujoco>
  <visual><global offwidth="64" offheight="48"/></visual>
  <worldbody>
    <geom size=".1"/>
    <camera name="side"/>
    <camera name="above" pos="0 0 1"/>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def physics() -> Physics:
    return Physics.from_xml_string(_TWO_CAMERAS)


@pytest.mark.parametrize(("camera_id", "number"), [("side", 0), ("above", 1), (0, 0), (1, 1)])
def test_a_camera_of_the_model_is_given_by_name_or_number(
    physics: Physics, camera_id: int | str, number: int
) -> None:
    view = view_of(physics, camera_id)
    assert view.fixedcamid == number
    assert view.type == mujoco.mjtCamera.mjCAMERA_FIXED


def test_the_free_camera_is_where_mujoco_puts_it(physics: Physics) -> None:
    view, expected = view_of(physics, FREE_CAMERA), mujoco.MjvCamera()
    mujoco.mjv_defaultFreeCamera(physics.model.ptr, expected)
    assert view.type == mujoco.mjtCamera.mjCAMERA_FREE
    assert view.distance == expected.distance
    assert view.lookat.tolist() == expected.lookat.tolist()


@pytest.mark.parametrize("camera_id", [2, -2])
def test_a_camera_that_does_not_exist_is_refused(physics: Physics, camera_id: int) -> None:
    with pytest.raises(ValueError, match=f"camera_id is {camera_id}; .* the model has 2 cameras"):
        view_of(physics, camera_id)


def test_only_the_free_camera_can_be_chosen_of_a_model_without_cameras() -> None:
    bare = Physics.from_xml_string("<mujoco/>")
    with pytest.raises(ValueError, match="expected -1, the free camera: the model has 0 cameras"):
        view_of(bare, 0)


def test_a_size_that_fits_the_buffer_is_returned_as_ints(physics: Physics) -> None:
    assert checked_size(physics, 48, 64) == (48, 64)
    assert checked_size(physics, True, 1) == (1, 1)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((0, 1), "image height is 0; expected a whole number of pixels, from 1 to 48"),
        ((1, -3), "image width is -3; expected"),
        ((1.5, 1), "image height is 1.5; expected"),
        ((49, 1), "image height 49 > 48"),
        ((1, 65), 'image width 65 > 64.*offwidth="65"'),
    ],
)
def test_a_size_that_the_model_cannot_have_is_refused(
    physics: Physics, size: tuple[Any, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        checked_size(physics, *size)


@pytest.mark.parametrize("camera_id", [None, 0.5, ["side"]])
def test_a_camera_that_is_neither_a_name_nor_a_number_is_refused(
    physics: Physics, camera_id: Any
) -> None:
    with pytest.raises(TypeError, match=r"camera_id is .*; expected the name or the number"):
        view_of(physics, camera_id)


def test_an_unknown_style_or_position_of_text_is_refused() -> None:
    with pytest.raises(ValueError, match=r"style is 'bigg'.*Did you mean 'big'"):
        TextOverlay(style="bigg")
    with pytest.raises(ValueError, match="position is 'centre'"):
        TextOverlay(position="centre")


def test_a_camera_of_a_batch_is_refused() -> None:
    batch = furnished().replicate(2, 1).physics
    for make in (Camera, MovableCamera):
        with pytest.raises(TypeError, match=r"render\(rows, \.\.\.\) of its BatchEnvironment"):
            make(batch, **SIZE)
