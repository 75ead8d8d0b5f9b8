"""Tests of limberjack.mujoco.rendering.uploads: pictures show changes of a model."""

import functools
from collections.abc import Callable
from typing import cast

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import Camera, Physics
from limberjack.mujoco.rendering import call, uploads

_MODEL = """
<mujoco>
  <visual><quality shadowsize="128"/><global offwidth="96" offheight="72"/></visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="1 .2 .3" width="16" height="16"/>
    <texture name="cube" type="cube" builtin="checker" rgb1="1 0 0" width="16" height="16"/>
    <texture name="flat" type="2d" builtin="checker" rgb1="0 1 0" width="16" height="16"/>
    <material name="cube" texture="cube"/>
    <material name="flat" texture="flat" texrepeat="3 3"/>
    <hfield name="low" nrow="8" ncol="9" size="1 1 .5 .1"/>
    <hfield name="high" nrow="5" ncol="7" size="1 1 .5 .1"/>
    <mesh name="small" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/>
    <mesh name="large" vertex="0 0 0  2 0 0  0 2 0  0 0 2" texcoord="0 0  1 0  0 1  1 1"
          face="0 2 1  0 1 3  0 3 2  1 2 3"/>
  </asset>
  <worldbody>
    <light pos="0 0 4"/>
    <geom type="plane" size="5 5 .1" material="flat" pos="0 0 -.2"/>
    <geom type="hfield" hfield="low" pos="0 2 0"/>
    <geom type="hfield" hfield="high" pos="2 0 0"/>
    <geom type="mesh" mesh="small" pos="-1 0 .5"/>
    <geom type="mesh" mesh="large" pos="-3 -1 .5" material="flat"/>
    <geom type="box" size=".5 .5 .5" material="cube" pos="0 -2 1"/>
    <camera name="eye" pos="0 -8 5" xyaxes="1 0 0 0 .5 .866"/>
  </worldbody>
</mujoco>
"""
_SIZE = {"height": 72, "width": 96, "camera_id": "eye"}


def _height_field(model: mujoco.MjModel) -> None:
    model.hfield("high").data[:] = np.random.RandomState(0).uniform(size=(5, 7))


def _height_fields_size(model: mujoco.MjModel) -> None:
    model.hfield("high").size[:2] *= 0.5


def _sky(model: mujoco.MjModel) -> None:
    start = model.tex("sky").adr[0]
    model.tex_data[start : start + 6 * 16 * 16 * 3] = np.arange(6 * 16 * 16 * 3) % 251


def _cube(model: mujoco.MjModel) -> None:
    start = model.tex("cube").adr[0]
    model.tex_data[start : start + 6 * 16 * 16 * 3] = np.arange(6 * 16 * 16 * 3) % 251


def _flat(model: mujoco.MjModel) -> None:
    model.tex_data[model.tex("flat").adr[0] :] = 77


def _mesh(model: mujoco.MjModel) -> None:
    model.mesh_vert[4:, 2] *= 1.5


def _picture_on_a_mesh(model: mujoco.MjModel) -> None:
    model.mesh_texcoord[:] *= 0.3


def _one_face(model: mujoco.MjModel) -> None:
    """One image on all sides of the sky, in the first bytes of the texture."""
    sky = model.tex("sky")
    sky.height[0] = sky.width[0] = 8
    model.tex_data[sky.adr[0] : sky.adr[0] + 8 * 8 * 3] = np.arange(8 * 8 * 3)


def _faces(model: mujoco.MjModel) -> None:
    """Six faces, and a height that counts for none of them."""
    model.tex("sky").width[0] = 12
    _sky(model)


def _rows(model: mujoco.MjModel) -> None:
    model.tex("flat").height[0] = 3


def _place(model: mujoco.MjModel) -> None:
    model.tex("flat").adr[0] -= 16 * 8 * 3


def _transparent(model: mujoco.MjModel) -> None:
    flat = model.tex("flat")
    flat.height[0], flat.nchannel[0] = 8, 4


_CHANGES = [
    *(_height_field, _height_fields_size, _sky, _cube, _flat, _mesh, _picture_on_a_mesh),
    *(_one_face, _faces, _rows, _place, _transparent),
]
_every_change = pytest.mark.parametrize("change", _CHANGES)


def _physics() -> Physics:
    return Physics.from_xml_string(_MODEL)


@functools.cache  # a private context takes longer than ten pictures
def _fresh(change: Callable[[mujoco.MjModel], None] | None) -> np.ndarray:
    """A picture of the changed model, which was never drawn before, in a private context."""
    physics = _physics()
    if change is not None:
        change(physics.model.ptr)
    physics.contexts.mujoco.ptr  # noqa: B018
    return physics.render(**_SIZE)


@_every_change
def test_pictures_show_changes(change: Callable[[mujoco.MjModel], None]) -> None:
    physics = _physics()
    camera = Camera(physics, **_SIZE)
    before = physics.render(**_SIZE), camera.render()
    change(physics.model.ptr)
    expected = _fresh(change)
    assert (expected != before[0]).any()
    for now in (physics.render(**_SIZE), camera.render(), physics.render(**_SIZE)):
        np.testing.assert_array_equal(now, expected)


@_every_change
def test_changes_of_one_simulation_are_not_seen_in_others(
    change: Callable[[mujoco.MjModel], None],
) -> None:
    changed, other, third = _physics(), _physics(), _physics()
    before = [physics.render(**_SIZE) for physics in (changed, other, third)]
    change(changed.model.ptr)
    _flat(third.model.ptr)
    expected = [_fresh(change), _fresh(None), _fresh(_flat)]
    np.testing.assert_array_equal(expected[1], before[1])
    for _ in range(2):
        for physics, picture in zip((changed, other, third), expected, strict=True):
            np.testing.assert_array_equal(physics.render(**_SIZE), picture)
    np.testing.assert_array_equal(_physics().render(**_SIZE), before[0])


def test_reverted_changes_are_seen() -> None:
    physics = _physics()
    before = physics.render(**_SIZE)
    original = physics.model.hfield_data.copy()
    _height_field(physics.model.ptr)
    assert (physics.render(**_SIZE) != before).any()
    physics.model.hfield_data[:] = original
    np.testing.assert_array_equal(physics.render(**_SIZE), before)


def test_simulations_that_change_share_a_context() -> None:
    several = [_physics() for _ in range(4)]
    for number, physics in enumerate(several):
        physics.render(**_SIZE)
        physics.model.hfield_data[:] = 1 / (number + 2)
    contexts = {call(physics.model._official, id) for physics in several}
    assert len(contexts) == 1
    assert call(_physics().model._official, id) not in contexts


def test_changes_are_seen_in_private_contexts() -> None:
    physics = _physics()
    context = physics.contexts.mujoco.ptr
    physics.render(**_SIZE)
    _mesh(physics.model.ptr)
    np.testing.assert_array_equal(physics.render(**_SIZE), _fresh(_mesh))
    assert physics.contexts.mujoco.ptr is context


def test_a_nested_picture_leaves_the_textures_of_the_outer_one() -> None:
    first, second = _physics(), _physics()
    for physics, level in ((first, 0.2), (second, 0.9)):
        physics.render(**_SIZE)
        physics.model.hfield_data[:] = level
    expected = first.render(**_SIZE)

    def drawn_after_the_other(_: mujoco.MjrContext) -> np.ndarray:
        second.render(**_SIZE)
        return first.render(**_SIZE)

    np.testing.assert_array_equal(call(first.model._official, drawn_after_the_other), expected)


def test_only_the_objects_that_differ_are_uploaded(monkeypatch: pytest.MonkeyPatch) -> None:
    uploaded: list[tuple[str, int]] = []

    def noted(size: str) -> Callable[..., None]:
        return lambda model, context, number: uploaded.append((size, number))

    kinds = tuple(kind._replace(upload=noted(kind.size)) for kind in uploads._KINDS)
    monkeypatch.setattr(uploads, "_KINDS", kinds)
    model = mujoco.MjModel.from_xml_string(_MODEL)
    held = uploads.Uploads(model)
    context = cast(mujoco.MjrContext, None)  # which only the functions replaced above would use
    held.update(model, context)
    assert not uploaded
    expected = [("nhfield", 1), ("nhfield", 1), ("ntex", 0), ("ntex", 1), ("ntex", 2), ("nmesh", 1)]
    expected += [("nmesh", 1), *(("ntex", number) for number in (0, 0, 2, 2, 2))]
    for change, one in zip(_CHANGES, expected, strict=True):
        change(model)
        assert not held.are_current(model)
        held.update(model, context)
        assert held.are_current(model)
        assert uploaded.pop() == one
        assert not uploaded


def test_a_cube_has_six_faces_where_its_height_is_not_its_width() -> None:
    model = mujoco.MjModel.from_xml_string(_MODEL)
    sky = model.tex("sky")
    for change, pixels in ((_sky, 6 * 16**2), (_one_face, 8**2), (_faces, 6 * 12**2)):
        change(model)
        part = uploads._part(model, "tex_data", sky.id)
        assert (part.start, part.stop) == (sky.adr[0], sky.adr[0] + 3 * pixels)


def test_models_that_nobody_can_change_are_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = suite.load("humanoid", "stand", {"random": 0})
    size = {"height": 8, "width": 8}
    expected = environment.physics.render(**size)

    def compare(*_: object) -> bool:
        raise AssertionError("textures of 12 MB were compared")

    monkeypatch.setattr(uploads, "_are_same", compare)
    np.testing.assert_array_equal(environment.physics.render(**size), expected)
    assert environment.physics.model.ptr  # from now on user code may change it
    environment.physics.render(**size)  # its own copy, for the first time
    with pytest.raises(AssertionError, match="were compared"):
        environment.physics.render(**size)


def test_every_field_that_is_uploaded_is_one_of_the_model() -> None:
    model = mujoco.MjModel.from_xml_string(_MODEL)
    for name in uploads.FIELDS:
        assert isinstance(getattr(model, name), np.ndarray)
