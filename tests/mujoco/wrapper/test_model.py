"""`MjModel` has dm_control's interface, whether the model is shared or not."""

import copy
import pickle
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack.mujoco import Physics, wrapper
from limberjack.mujoco.wrapper import core
from tests.mujoco.wrapper.conftest import XML

_GRAVITY = mujoco.mjtDisableBit.mjDSBL_GRAVITY


_CONTACT = mujoco.mjtDisableBit.mjDSBL_CONTACT


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
    xml.write_text(XML)
    model.save_binary(str(binary))
    for other in (
        wrapper.MjModel.from_xml_string(XML.encode()),
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


def test_an_unnamed_object_has_an_empty_name(model: wrapper.MjModel) -> None:
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


@pytest.mark.parametrize("name", [None, 5, ["ball"]])
def test_a_name_that_is_no_text_is_refused(model: wrapper.MjModel, name: Any) -> None:
    # MuJoCo's own function ends the process at None.
    with pytest.raises(TypeError, match="expected the name of an object"):
        model.name2id(name, "body")


@pytest.mark.parametrize(
    "flags",
    [
        ("gravity",),
        ("Gravity",),
        (_GRAVITY,),
        (_GRAVITY.value, "contact"),
        (_GRAVITY, _CONTACT),
        (),
    ],
)
def test_parts_are_disabled_within_the_context(model: wrapper.MjModel, flags: Any) -> None:
    bits = {"gravity": _GRAVITY.value, "contact": _CONTACT.value}
    expected = sum(bits[flag.lower()] if isinstance(flag, str) else int(flag) for flag in flags)
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


def test_the_model_that_was_compiled_last_is_written_as_xml(tmp_path: Path) -> None:
    first = wrapper.MjModel.from_xml_string(XML)
    path = tmp_path / "model.xml"
    core.save_last_parsed_model_to_xml(str(path), first)
    assert 'model="balls"' in path.read_text(encoding="utf-8")
    again = wrapper.MjModel.from_xml_path(str(path))
    np.testing.assert_array_equal(again.geom_pos, first.geom_pos)
    core.save_last_parsed_model_to_xml(str(path), again)


def test_a_model_that_was_not_compiled_last_is_not_written(tmp_path: Path) -> None:
    first = wrapper.MjModel.from_xml_string(XML)
    wrapper.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(ValueError, match="most recently loaded"):
        core.save_last_parsed_model_to_xml(str(tmp_path / "model.xml"), first)
    assert not list(tmp_path.iterdir())


def test_a_model_that_mujoco_itself_has_parsed_since_is_not_mixed_up(tmp_path: Path) -> None:
    first = wrapper.MjModel.from_xml_string(XML)
    mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(ValueError, match="most recently loaded"):
        core.save_last_parsed_model_to_xml(str(tmp_path / "model.xml"), first)


_NAMED = (
    "<mujoco model='{}'><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
)


def _load(name: str) -> wrapper.MjModel:
    """A model that is compiled once and shared."""
    return Physics.from_shared_xml(_NAMED.format(name), {}).model


def _saved(path: Path, model: wrapper.MjModel | None = None) -> str:
    core.save_last_parsed_model_to_xml(str(path / "model.xml"), model)
    return (path / "model.xml").read_text(encoding="utf-8")


def test_a_model_that_was_loaded_again_is_the_one_that_is_written(tmp_path: Path) -> None:
    first, other, again = _load("one"), _load("two"), _load("one")
    assert again._official is first._official
    for _ in range(2):
        assert 'model="one"' in _saved(tmp_path)
        assert 'model="one"' in _saved(tmp_path, again)
    for earlier in (first, other, again.copy()):
        with pytest.raises(ValueError, match="most recently loaded"):
            _saved(tmp_path, earlier)


@pytest.mark.parametrize("is_cached", [True, False])
def test_changes_of_a_shared_model_are_written_even_after_its_end(
    tmp_path: Path, is_cached: bool
) -> None:
    name = f"edited, {is_cached}"
    if is_cached:
        _load(name)
        _load("two")
    model = _load(name)
    assert model.opt.timestep == 0.002  # reading a nested struct copies the model
    assert f'model="{name}"' in _saved(tmp_path, model)
    model.body_mass[1] = 4.25
    assert 'mass="4.25"' in _saved(tmp_path, model)
    del model
    assert 'mass="4.25"' in _saved(tmp_path)
