"""Tests of limberjack.mujoco.dressing: a look draws what the same changes of a model would draw."""

import os
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from limberjack import suite
from limberjack.mujoco import Physics, dressing
from limberjack.mujoco.dressing import behind, dressed, flags_for, look_of, staged
from limberjack.mujoco.rendering import uploads as rendering_uploads
from limberjack.mujoco.rendering.uploads import _KINDS
from limberjack.worlds.appearance import Appearance, Look, Looks
from limberjack.worlds.appearance.backdrop import is_green
from limberjack.worlds.appearance.viewpoint import Pose, distracted, sphere_of, turned
from tests.plain_pictures import draw_plainly
from tests.small_sky import small_sky

pytestmark = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="MUJOCO_GL turns rendering off"
)
_SIZE = {"height": 40, "width": 40, "camera_id": 0}
_SIX = ("reacher", "cartpole", "finger", "cheetah", "ball_in_cup", "walker")


@pytest.fixture(autouse=True)
def _sky() -> Iterator[None]:
    with small_sky():
        yield


def _physics(domain: str) -> Physics:
    """A simulation in the first start of the domain's first task."""
    task = next(task for name, task in suite.ALL_TASKS if name == domain)
    env = suite.load(domain, task, {"random": 0})
    env.reset()
    draw_plainly(env.physics.model)
    return env.physics


def _look(given: Any, seed: int = 0) -> Look:
    looks = Looks(Appearance.of(given), 1, 0.01)
    looks.begin(0, np.random.RandomState(seed))
    look = looks.of(0)
    assert look is not None
    return look


def _drawn(physics: Physics, look: Look | None, **kwargs: Any) -> np.ndarray:
    physics.simulation.look = look
    try:
        return physics.render(**{**_SIZE, **kwargs})
    finally:
        physics.simulation.look = None


def _eyes(physics: Physics, look: Look | None) -> np.ndarray:
    """Places and directions of the eyes with which a picture is drawn."""
    seen = []

    def callback(physics: Physics, scene: Any) -> None:
        seen.append([[eye.pos.copy(), eye.forward.copy(), eye.up.copy()] for eye in scene.camera])

    _drawn(physics, look, scene_callback=callback)
    return np.array(seen)


@pytest.mark.parametrize("domain", ["walker", "reacher", "finger"])
def test_colours_are_those_of_a_model_with_these_materials(domain: str) -> None:
    physics, look = _physics(domain), _look({"colors": 0.3})
    before = physics.model.mat_rgba.copy()
    drawn, original = _drawn(physics, look), _drawn(physics, None)
    assert_array_equal(physics.model.mat_rgba, before)
    colors = look.colors(before[:, :3].astype(float), 0.0)
    assert colors is not None
    physics.model.mat_rgba[:, :3] = colors
    assert_array_equal(drawn, _drawn(physics, None))
    assert not np.array_equal(drawn, original)


@pytest.mark.parametrize("domain", _SIX)
def test_a_camera_is_moved_as_the_original_moves_the_data(domain: str) -> None:
    physics, look = _physics(domain), _look({"camera": 0.3, "rotate": 30})
    seen, original = _eyes(physics, look), _eyes(physics, None)
    model, data = physics.model._official, physics.data._data
    is_fixed = domain not in ("walker", "cheetah")
    centre = np.zeros(3) if is_fixed else data.subtree_com[1]
    pose = Pose(data.cam_xpos[0].copy(), data.cam_xmat[0].reshape(3, 3).copy())
    start = sphere_of(pose.position if is_fixed else model.cam_poscom0[0])
    # The angles of an axis may be 0, up to rounding.
    np.testing.assert_allclose(start, sphere_of(pose.position - centre), atol=1e-12)
    distance = np.linalg.norm(pose.position - (dressing._centre(model) if is_fixed else centre))
    lookat = pose.position - pose.axes[:, 2] * distance
    found = look.place(0, start, 0.0)
    assert found is not None
    moved = distracted(pose, *found, start, centre, lookat)
    for turn in look.turns(physics.model.name):
        moved = turned(moved, turn)
    data.cam_xpos[0], data.cam_xmat[0] = moved.position, moved.axes.ravel()
    # The eyes of a scene are of single precision.
    np.testing.assert_allclose(seen, _eyes(physics, None), atol=2e-6)
    assert np.abs(np.subtract(seen, original)).max() > 0.05
    assert start.is_above is (domain != "reacher")  # DCS: limit_to_upper_quadrant


def test_the_free_camera_moves_too_and_data_stay_the_same() -> None:
    physics, look = _physics("walker"), _look({"camera": 0.3})
    before = physics.data.cam_xpos.copy(), physics.data.cam_xmat.copy()
    assert not np.array_equal(
        _drawn(physics, look, camera_id=-1), _drawn(physics, None, camera_id=-1)
    )
    assert_array_equal(physics.data.cam_xpos, before[0])
    assert_array_equal(physics.data.cam_xmat, before[1])


def test_depth_and_segmentation_see_the_moved_camera_and_no_background() -> None:
    physics = _physics("walker")
    for kind in ({"depth": True}, {"segmentation": True}):
        plain = _drawn(physics, None, **kind)
        assert not np.array_equal(_drawn(physics, _look({"camera": 0.3}), **kind), plain)
        seen = _drawn(physics, _look({"preset": "video_hard", "background": "noise"}), **kind)
        assert_array_equal(seen, plain)


@pytest.mark.parametrize("place", ["scene", "picture"])
def test_a_background_is_that_of_a_model_with_this_sky(place: str) -> None:
    physics, look = _physics("cartpole"), _look({"background": "noise", "place": place})
    drawn = _drawn(physics, look)
    background = look.background(0.0)
    assert background is not None
    texture = background if place == "scene" else np.full((8, 8, 3), [51, 204, 51], np.uint8)
    # As the original does: one square for all sides of the sky.
    xml = (
        f'<texture name="skybox" type="skybox" builtin="flat" width="{len(texture)}"'
        f' height="{len(texture)}"/>'
    )
    other = _with_sky(physics, texture, xml)
    if place == "scene":
        other.model.mat_rgba[other.model.name2id("grid", "material"), 3] = 0.3
    expected = _drawn(other, None)
    if place == "picture":
        assert is_green(expected).mean() > 0.1
        expected = behind(look, expected, 0.0)
    assert_array_equal(drawn, expected)
    assert not np.array_equal(drawn, _drawn(physics, None))


def _with_sky(physics: Physics, texture: np.ndarray, xml: str) -> Physics:
    """A copy of the cartpole whose model was compiled with a sky of the texture's size."""
    from limberjack.suite import cartpole, common

    source, assets = cartpole.get_model_and_assets()
    sky = "./common/skybox.xml"
    assert sky in assets
    changed = {**assets, sky: f"<mujoco><asset>{xml}</asset></mujoco>".encode()}
    assert common is not None
    other = cartpole.Physics.from_xml_string(source, changed)
    draw_plainly(other.model)
    model = other.model.ptr
    model.tex_height[0] = model.tex_width[0] = len(texture)
    model.tex_data[: texture.size] = texture.ravel()
    other.data.qpos[:] = physics.data.qpos
    other.forward()
    return other


@pytest.mark.parametrize("domain", _SIX)
@pytest.mark.parametrize(
    "appearance", [{"camera": 0.3, "colors": 0.3, "background": "noise"}, "rotate_shift_hard"]
)
def test_a_dressed_model_is_drawn_as_the_scene_is_dressed(domain: str, appearance: Any) -> None:
    physics, look = _physics(domain), _look(appearance)
    model, data = physics.model._official, physics.data._data
    other = mujoco.MjData(made := dressed(look, model, data))
    # The body that a camera follows has moved since.
    data.qpos[-1] += 0.3
    other.qpos[:] = data.qpos
    physics.forward()
    mujoco.mj_forward(made, other)
    # Rotations that are composed in another order round differently.
    np.testing.assert_allclose(_eyes_of(made, other), _eyes(physics, look)[0], atol=1e-5)
    assert np.abs(np.subtract(_eyes_of(made, other), _eyes(physics, None)[0])).max() > 0.01
    colors = look.colors(model.mat_rgba[:, :3].astype(float), 0.0)
    if colors is not None:
        assert_array_equal(made.mat_rgba[:, :3], colors.astype(np.float32))
    background = look.background(0.0)
    if background is not None:
        sky = int(np.flatnonzero(made.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX)[0])
        assert_array_equal(dressing._pixels(made, sky), background)


def _eyes_of(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """As `_eyes`, of the model's own camera."""
    scene, view = mujoco.MjvScene(model, 1000), mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    parts = mujoco.MjvOption(), mujoco.MjvPerturb(), view, mujoco.mjtCatBit.mjCAT_ALL.value
    mujoco.mjv_updateScene(model, data, *parts, scene)
    return np.array([[eye.pos, eye.forward, eye.up] for eye in scene.camera])


def test_a_dressed_model_has_the_background_of_a_picture_on_its_sky() -> None:
    physics = _physics("walker")
    look = _look({"preset": "video_hard", "background": "noise"})
    made = dressed(look, physics.model._official, physics.data._data)
    floor = physics.model.name2id("grid", "material")
    assert (made.mat_rgba[floor, 3], physics.model.mat_rgba[floor, 3]) == (0.0, 1.0)
    background = look.background(0.0)
    assert background is not None
    assert background.tobytes() in made.tex_data.tobytes()


def test_a_palette_repaints_floor_body_and_sky() -> None:
    physics, look = _physics("walker"), _look("color_hard")
    assert look.palette is not None
    stage = staged(look, physics.model._official, physics.data._data)
    assert stage is not None
    sky, floor = (dressing._pixels(stage, number) for number in (0, 1))
    gradient = sky[(sky < 255).any(axis=-1)]
    # Colours are rounded to whole numbers.
    np.testing.assert_allclose(gradient.max(axis=0), look.palette.sky * 255, atol=0.5)
    for place, color in (((75, 75), "floor"), ((75, 225), "second_floor")):
        np.testing.assert_allclose(floor[place], getattr(look.palette, color) * 255, atol=0.5)
    drawn = _drawn(physics, look)
    physics.model.mat_rgba[physics.model.name2id("self", "material"), :3] = look.palette.body
    assert_array_equal(_drawn(physics, look), drawn)  # the body had this colour already


def test_the_floor_before_a_background_is_that_of_the_published_suite() -> None:
    look, picture = (
        _look({"background": "noise"}),
        _look({"preset": "video_hard", "background": "noise"}),
    )
    found = {domain: dressing._opacity(look, _physics(domain).model._official) for domain in _SIX}
    assert found == {
        "reacher": 0.0,
        "cartpole": 0.3,
        "finger": 0.3,
        "ball_in_cup": 0.3,
        "walker": 1.0,
        "cheetah": 1.0,
    }
    model = _physics("walker").model._official
    assert dressing._opacity(_look({"background": "noise", "floor": 0.5}), model) == 0.5
    assert dressing._opacity(picture, model) is None
    assert dressing._opacity(_look({"colors": 0.1}), model) is None


def test_two_simulations_of_one_model_keep_their_own_textures() -> None:
    first, second = (suite.load("walker", "walk", {"random": 0}).physics for _ in range(2))
    assert first.model._official is second.model._official
    looks = [_look({"background": "noise"}, seed) for seed in (0, 1)]
    stages = [
        staged(look, one.model._official, one.data._data)
        for look, one in zip(looks, (first, second), strict=True)
    ]
    assert stages[0] is not None
    assert stages[1] is not None
    assert not np.array_equal(stages[0].tex_data, stages[1].tex_data)
    pictures = [_drawn(first, looks[0]), _drawn(second, looks[1])]
    for _ in range(2):
        assert_array_equal(_drawn(first, looks[0]), pictures[0])
        assert_array_equal(_drawn(second, looks[1]), pictures[1])
    assert not np.array_equal(pictures[0], pictures[1])


def test_the_next_picture_without_a_look_is_the_models_own() -> None:
    physics = _physics("walker")
    before = _drawn(physics, None)
    _drawn(physics, _look({"background": "noise", "colors": 0.3, "camera": 0.3, "rotate": 90}))
    assert_array_equal(_drawn(physics, None), before)


def test_a_stage_follows_height_fields_and_is_made_again_for_other_sizes() -> None:
    physics = _physics("quadruped")
    env = suite.load("quadruped", "escape", {"random": 0})
    env.reset()
    model, data = env.physics.model._official, env.physics.data._data
    look = _look({"background": "noise"})
    stage = staged(look, model, data)
    assert stage is not None
    assert_array_equal(stage.hfield_data, model.hfield_data)
    env.reset()
    model = env.physics.model._official
    again = staged(look, model, data)
    assert again is not None
    assert_array_equal(again.hfield_data, model.hfield_data)
    other = staged(_look("color_hard"), model, data)
    assert other is not None
    assert other is not again
    assert staged(_look("rotate_hard"), model, data) is None
    assert look_of(physics) is None


def test_fast_pictures_keep_a_sky_that_is_a_background() -> None:
    physics, look = _physics("walker"), _look({"background": "noise"})
    fast = _drawn(physics, look, quality="fast")
    assert fast[:6].std() > 10
    assert flags_for(look, {"skybox": False, "shadow": False}) == {"skybox": True, "shadow": False}
    assert flags_for(_look({"colors": 0.1}), {"skybox": False}) == {"skybox": False}


def test_a_callback_sees_the_dressed_scene() -> None:
    physics, look = _physics("walker"), _look({"colors": 0.3})
    seen = []

    def callback(physics: Physics, scene: Any) -> None:
        seen.append(np.array([geom.rgba for geom in scene.geoms]))

    plain, drawn = (_drawn(physics, one, scene_callback=callback) for one in (None, look))
    assert not np.array_equal(plain, drawn)
    assert not np.array_equal(seen[0], seen[1])


def test_geoms_with_colours_of_their_own_keep_them() -> None:
    xml = """<mujoco><asset><material name="m" rgba=".2 .4 .6 1"/></asset><worldbody>
    <camera pos="0 0 3"/><geom size=".3" material="m"/>
    <geom size=".3" pos=".7 0 0" material="m" rgba="1 0 0 1"/></worldbody></mujoco>"""
    physics, colors = Physics.from_xml_string(xml), []

    def callback(physics: Physics, scene: Any) -> None:
        colors.append([geom.rgba.tolist() for geom in scene.geoms])

    _drawn(physics, _look({"colors": 0.3}), scene_callback=callback)
    assert colors[0][1] == [1, 0, 0, 1]
    assert colors[0][0] != pytest.approx([0.2, 0.4, 0.6, 1])


@pytest.mark.parametrize(("dynamic", "uploads"), [(False, 1), (True, 3)])
def test_only_textures_that_change_are_uploaded(
    monkeypatch: pytest.MonkeyPatch, dynamic: bool, uploads: int
) -> None:
    physics, look = _physics("walker"), _look({"background": "noise", "dynamic": dynamic}, 5)
    uploaded = []

    def upload(model: Any, context: Any, number: int) -> None:
        uploaded.append(number)
        mujoco.mjr_uploadTexture(model, context, number)

    kinds = [kind._replace(upload=upload) if kind.size == "ntex" else kind for kind in _KINDS]
    _drawn(physics, _look({"background": "noise"}, 6))  # which makes the canvas
    monkeypatch.setattr(rendering_uploads, "_KINDS", tuple(kinds))
    for step in range(3):
        physics.data.time = 0.01 * step
        _drawn(physics, look)
    assert uploaded == [0] * uploads
