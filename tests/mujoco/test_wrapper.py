"""Tests of limberjack.mujoco.wrapper: models, data, bindings and visualisation structs."""

import copy
import ctypes
import pickle
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import wrapper
from limberjack.mujoco.wrapper import mjbindings, util

_XML = """
<mujoco model="balls">
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="ball" pos="0 0 .09">
      <freejoint name="free"/>
      <geom name="ball" size=".1" mass="2"/>
      <site name="top" pos="0 0 .1"/>
    </body>
    <body><geom size=".1" pos="3 0 3"/></body>
  </worldbody>
  <sensor><framepos name="ball" objtype="body" objname="ball"/></sensor>
</mujoco>
"""
_GRAVITY = mujoco.mjtDisableBit.mjDSBL_GRAVITY
_CONTACT = mujoco.mjtDisableBit.mjDSBL_CONTACT


@pytest.fixture
def model() -> wrapper.MjModel:
    return wrapper.MjModel.from_xml_string(_XML)


@pytest.fixture
def data(model: wrapper.MjModel) -> wrapper.MjData:
    data = wrapper.MjData(model)
    mujoco.mj_forward(model.ptr, data.ptr)
    return data


@pytest.mark.parametrize("way", ["copy", "deepcopy", "pickle", "bytes"])
def test_a_model_is_the_same_after_a_copy(model: wrapper.MjModel, way: str) -> None:
    model.opt.timestep = 0.125
    made: dict[str, Any] = {
        "copy": lambda: copy.copy(model),
        "deepcopy": lambda: copy.deepcopy(model),
        "pickle": lambda: pickle.loads(pickle.dumps(model)),
        "bytes": lambda: wrapper.MjModel.from_byte_string(model.to_bytes()),
    }
    other = made[way]()
    assert other.to_bytes() == model.to_bytes()
    other.opt.timestep = 0.5
    assert model.opt.timestep == 0.125


def test_a_model_is_read_from_text_bytes_and_files(model: wrapper.MjModel, tmp_path: Path) -> None:
    xml, binary = tmp_path / "balls.xml", tmp_path / "balls.mjb"
    xml.write_text(_XML)
    model.save_binary(str(binary))
    for other in (
        wrapper.MjModel.from_xml_string(_XML.encode()),
        wrapper.MjModel.from_xml_path(str(xml)),
        wrapper.MjModel.from_binary_path(str(binary)),
    ):
        assert other.to_bytes() == model.to_bytes()


@pytest.mark.parametrize(
    ("name", "kind", "number"),
    [
        ("world", "body", 0),
        ("ball", "body", 1),
        ("ball", "geom", 1),
        ("floor", mujoco.mjtObj.mjOBJ_GEOM, 0),
        ("free", mujoco.mjtObj.mjOBJ_JOINT.value, 0),
        ("top", "site", 0),
        ("ball", "sensor", 0),
    ],
)
def test_names_and_numbers_of_objects(
    model: wrapper.MjModel, name: str, kind: Any, number: int
) -> None:
    assert model.name2id(name, kind) == number
    assert model.id2name(number, kind) == name


def test_what_has_no_name_has_an_empty_one(model: wrapper.MjModel) -> None:
    assert model.id2name(2, "body") == ""
    assert model.id2name(99, "body") == ""


def test_unknown_names_and_kinds_are_refused_with_suggestions(model: wrapper.MjModel) -> None:
    with pytest.raises(wrapper.Error, match=r"'body'.*'bal'.*Did you mean 'ball'\? Names: world"):
        model.name2id("bal", "body")
    with pytest.raises(wrapper.Error, match=r"'camera'.*'side'.*Names: none"):
        model.name2id("side", "camera")
    for use in (model.name2id, lambda name, kind: model.id2name(0, kind)):
        with pytest.raises(wrapper.Error, match="'bodi' is not a valid object type"):
            use("ball", "bodi")
    assert issubclass(wrapper.Error, ValueError)


@pytest.mark.parametrize(
    "flags", [("gravity",), (_GRAVITY,), (_GRAVITY.value, "contact"), (_GRAVITY, _CONTACT), ()]
)
def test_parts_are_disabled_within_the_context(model: wrapper.MjModel, flags: Any) -> None:
    bits = {"gravity": _GRAVITY.value, "contact": _CONTACT.value}
    expected = sum(bits.get(flag, flag) if isinstance(flag, str) else int(flag) for flag in flags)
    model.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_LIMIT.value
    before = model.opt.disableflags
    with model.disable(*flags):
        assert model.opt.disableflags == before | expected
        with model.disable("sensor"):
            pass
        assert model.opt.disableflags == before | expected
    assert model.opt.disableflags == before


def test_an_unknown_flag_is_refused_and_nothing_disabled(model: wrapper.MjModel) -> None:
    with pytest.raises(ValueError, match=r"'gravty' is not a valid flag name.*gravity"):
        model.disable("contact", "gravty").__enter__()
    assert model.opt.disableflags == 0


def test_every_flag_of_this_mujoco_has_a_name(model: wrapper.MjModel) -> None:
    for name, bit in mujoco.mjtDisableBit.__members__.items():
        if name.startswith("mjDSBL_"):
            with model.disable(name.removeprefix("mjDSBL_").lower()):
                assert model.opt.disableflags == bit.value


def test_data_has_the_official_fields_and_the_model(
    model: wrapper.MjModel, data: wrapper.MjData
) -> None:
    assert data.model is model
    assert data.ptr is data._data
    assert np.shares_memory(data.qpos, data.ptr.qpos)
    data.qpos = np.arange(7.0)
    data.time = 3.0
    np.testing.assert_array_equal(data.ptr.qpos, np.arange(7.0))
    assert data.ptr.time == 3.0
    assert {"qpos", "contact_force", "model"} <= set(dir(data))
    assert not hasattr(data, "nothing")
    assert wrapper.MjData(mujoco.MjData(model.ptr)).model.nbody == 3
    for bad in (None, model.ptr, "data"):
        with pytest.raises(TypeError, match=r"Expected wrapper\.MjModel or mujoco\.MjData"):
            wrapper.MjData(bad)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("way", ["copy", "method", "deepcopy", "pickle"])
def test_a_copy_of_data_is_the_same_and_apart(data: wrapper.MjData, way: str) -> None:
    made: dict[str, Any] = {
        "copy": lambda: copy.copy(data),
        "method": lambda: data.copy(),
        "deepcopy": lambda: copy.deepcopy(data),
        "pickle": lambda: pickle.loads(pickle.dumps(data)),
    }
    other = made[way]()
    assert (other.model is data.model) == (way in ("copy", "method"))
    for name in ("qpos", "xpos", "qacc_warmstart", "sensordata"):
        np.testing.assert_array_equal(getattr(other, name), getattr(data, name))
    other.qpos[:] = 5.0
    assert not np.any(data.qpos == 5.0)


def test_contacts_are_those_there_are(data: wrapper.MjData) -> None:
    assert len(data.contact) == data.ncon == 1
    assert data.contact.geom[0].tolist() == [0, 1]


def test_a_contacts_force_carries_the_weight(model: wrapper.MjModel, data: wrapper.MjData) -> None:
    for _ in range(2000):
        mujoco.mj_step(model.ptr, data.ptr)
    mujoco.mj_step1(model.ptr, data.ptr)
    force, torque = data.contact_force(0)
    # At rest; what the solver leaves over.
    assert force[0] == pytest.approx(2 * 9.81, rel=1e-3)
    assert np.abs([*force[1:], *torque]).max() < 1e-3
    for bad in (-1, 1, 99):
        with pytest.raises(ValueError, match=rf"between 0 and 0 \(inclusive\), got: {bad}"):
            data.contact_force(bad)


def test_an_objects_velocity_is_linear_then_angular(
    model: wrapper.MjModel, data: wrapper.MjData
) -> None:
    data.qvel[:] = [1, 2, 3, 0.1, 0.2, 0.3]
    mujoco.mj_forward(model.ptr, data.ptr)
    velocity = data.object_velocity("ball", "body")
    assert velocity.shape == (2, 3)
    # Rounded on its way through the spatial velocity.
    np.testing.assert_allclose(velocity, [[1, 2, 3], [0.1, 0.2, 0.3]], atol=1e-12)
    np.testing.assert_array_equal(data.object_velocity(1, mujoco.mjtObj.mjOBJ_BODY), velocity)
    turned = np.array([0.0, 0.0, 0.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    data.qpos[:] = turned  # a quarter turn about z
    mujoco.mj_forward(model.ptr, data.ptr)
    local = data.object_velocity("ball", "body", local_frame=True)
    np.testing.assert_allclose(local[0], [2, -1, 3], atol=1e-12)
    with pytest.raises(wrapper.Error, match="'bal'"):
        data.object_velocity("bal", "body")


def test_freeing_twice_is_fine(model: wrapper.MjModel, data: wrapper.MjData) -> None:
    for thing in (data, model, wrapper.MjvScene()):
        thing.free()
        thing.free()


def test_a_callback_holds_within_its_context_and_is_put_back(
    model: wrapper.MjModel, data: wrapper.MjData
) -> None:
    calls = []
    before = mujoco.get_mjcb_control()
    with wrapper.callback_context("mjcb_control", lambda m, d: calls.append("outer")):
        mujoco.mj_forward(model.ptr, data.ptr)
        with wrapper.callback_context("mjcb_control", lambda m, d: calls.append("inner")):
            mujoco.mj_forward(model.ptr, data.ptr)
        mujoco.mj_forward(model.ptr, data.ptr)
    mujoco.mj_forward(model.ptr, data.ptr)
    assert calls == ["outer", "inner", "outer"]
    with pytest.raises(ZeroDivisionError), wrapper.callback_context("mjcb_control", print):
        raise ZeroDivisionError
    assert mujoco.get_mjcb_control() is before
    wrapper.set_callback("mjcb_control", lambda m, d: calls.append("set"))
    mujoco.mj_forward(model.ptr, data.ptr)
    wrapper.set_callback("mjcb_control", None)
    mujoco.mj_forward(model.ptr, data.ptr)
    assert calls[3:] == ["set"]


def test_enums_are_tuples_of_ints_with_mujocos_values() -> None:
    for name in ("mjtJoint", "mjtObj", "mjtGeom", "mjtDisableBit", "mjtRndFlag", "mjtWarning"):
        made, official = getattr(mjbindings.enums, name), getattr(mujoco, name).__members__
        assert made._fields == tuple(official)
        assert [type(value) for value in made] == [int] * len(made)
        assert [*made] == [int(value.value) for value in official.values()]
        assert getattr(mjbindings.enums, name) is made
    assert mjbindings.enums.mjtJoint.mjJNT_HINGE == 3
    with pytest.raises(AttributeError, match="has no enum 'mjtNothing'"):
        mjbindings.enums.mjtNothing  # noqa: B018
    with pytest.raises(AttributeError):
        mjbindings.enums.MjModel  # noqa: B018


def test_constants_are_mujocos() -> None:
    assert mjbindings.constants.mjMAXVAL == 1e10
    assert mjbindings.constants.mjNREF == mujoco.mjNREF
    for name in ("mjNOTHING", "mj_step", "MjModel"):
        with pytest.raises(AttributeError, match=f"has no constant '{name}'"):
            getattr(mjbindings.constants, name)


def test_functions_are_the_official_ones() -> None:
    assert mjbindings.mjlib.mj_step is mujoco.mj_step
    assert mjbindings.functions.mjlib is mjbindings.mjlib is util.get_mjlib()
    assert mjbindings.functions.mjDISABLESTRING == mujoco.mjDISABLESTRING


def test_text_and_bytes() -> None:
    for given in ("größer", "größer".encode()):
        assert util.to_native_string(given) == "größer"
        assert util.to_binary_string(given) == "größer".encode()


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
    figure.range_ = [[1.0, 2.0], [3.0, 4.0]]
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


def test_the_timer_is_switched_on_and_off() -> None:
    before = mujoco.get_mjcb_time()
    try:
        wrapper.enable_timer()
        assert mujoco.get_mjcb_time() is not None
        wrapper.enable_timer(False)
        assert mujoco.get_mjcb_time() is None
    finally:
        mujoco.set_mjcb_time(before)


def test_a_c_function_is_a_callback(model: wrapper.MjModel, data: wrapper.MjData) -> None:
    calls = []
    kind = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
    function = kind(lambda m, d: calls.append("C"))
    with wrapper.callback_context("mjcb_passive", function):
        mujoco.mj_forward(model.ptr, data.ptr)
    assert calls == ["C"]
