"""The visualisation structs with dm_control's additions."""

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import wrapper


def test_visualisation_structs_are_official_with_their_own_ptr(model: wrapper.MjModel) -> None:
    made = {
        mujoco.MjvCamera: wrapper.MjvCamera(),
        mujoco.MjvOption: wrapper.MjvOption(),
        mujoco.MjvPerturb: wrapper.MjvPerturb(),
        mujoco.MjvFigure: wrapper.MjvFigure(),
        mujoco.MjvScene: wrapper.MjvScene(model),
    }
    for kind, thing in made.items():
        assert isinstance(thing, kind)
        assert thing.ptr is thing


def test_rangefinders_are_not_drawn_by_default() -> None:
    flag = mujoco.mjtVisFlag.mjVIS_RANGEFINDER
    assert mujoco.MjvOption().flags[flag]
    assert not wrapper.MjvOption().flags[flag]


def test_attributes_named_like_keywords_have_second_names() -> None:
    camera, figure = wrapper.MjvCamera(), wrapper.MjvFigure()
    camera.type_ = mujoco.mjtCamera.mjCAMERA_FIXED.value
    assert camera.type == camera.type_ == mujoco.mjtCamera.mjCAMERA_FIXED.value
    figure.range_ = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(figure.range, figure.range_)


def test_a_scene_holds_what_is_drawn_of_the_model(
    model: wrapper.MjModel, data: wrapper.MjData
) -> None:
    scene = wrapper.MjvScene(model)
    assert scene.maxgeom >= 1000
    assert len(scene.geoms) == 0
    camera, option, everything = wrapper.MjvCamera(), wrapper.MjvOption(), 7
    mujoco.mjv_updateScene(model.ptr, data.ptr, option, None, camera, everything, scene)
    assert len(scene.geoms) == scene.ngeom > 2
    assert wrapper.MjvScene(model, max_geom=5).maxgeom == 5
    assert wrapper.MjvScene().ngeom == 0


def test_rendering_flags_hold_within_their_context(model: wrapper.MjModel) -> None:
    scene = wrapper.MjvScene(model)
    before = scene.flags.copy()
    wireframe, shadow = mujoco.mjtRndFlag.mjRND_WIREFRAME, mujoco.mjtRndFlag.mjRND_SHADOW
    with scene.override_flags({"wireframe": True, shadow: not before[shadow]}):
        assert scene.flags[wireframe]
        assert scene.flags[shadow] != before[shadow]
    np.testing.assert_array_equal(scene.flags, before)
    for nothing in (None, {}):
        with scene.override_flags(nothing):
            np.testing.assert_array_equal(scene.flags, before)
    with pytest.raises(ValueError, match=r"'wirefram' is not a rendering flag.*wireframe"):
        scene.override_flags({"shadow": False, "wirefram": True}).__enter__()
    np.testing.assert_array_equal(scene.flags, before)
