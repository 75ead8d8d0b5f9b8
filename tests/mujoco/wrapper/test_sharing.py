"""Compiled models are shared, cached, and copied before they can be changed."""

import copy
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import wrapper
from limberjack.mujoco.wrapper.sharing import SharedModel

_XML = """
<mujoco model="balls">
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="ball" pos="0 0 .09"><freejoint/><geom name="ball" size=".1" mass="2"/></body>
    <body><geom size=".1" pos="3 0 3"/></body>
  </worldbody>
</mujoco>
"""


def shared_pair() -> tuple[wrapper.MjModel, wrapper.MjModel]:
    """Two models that share a compiled model."""
    shared = SharedModel(mujoco.MjModel.from_xml_string(_XML))
    return wrapper.MjModel(shared), wrapper.MjModel(shared)


def test_reading_numbers_and_names_leaves_a_model_shared() -> None:
    model, twin = shared_pair()
    assert (model.nbody, model.ngeom, model.name) == (3, 3, "balls")
    assert model.name2id("ball", "geom") == 1
    assert model.id2name(1, "geom") == "ball"
    assert isinstance(model.names, bytes)
    assert "body_pos" in dir(model)
    assert not hasattr(model, "nothing")
    assert model.to_bytes() == twin.to_bytes()
    assert model._model is twin._model


@pytest.mark.parametrize(
    "touch",
    [
        lambda m: m.ptr,
        lambda m: m.opt,
        lambda m: m.body_pos,
        lambda m: m.body("ball"),
        lambda m: m.vis,
        lambda m: m.stat,
        lambda m: m.disable("gravity").__enter__(),
        lambda m: setattr(m, "body_mass", np.ones(3)),
        lambda m: m.geom_rgba,
    ],
)
def test_the_first_touch_that_could_change_a_model_copies_it_once(touch: Any) -> None:
    model, twin = shared_pair()
    shared = twin._model
    touch(model)
    own = model._model
    assert own is not shared
    assert twin._model is shared
    touch(model)
    assert model._model is own
    assert model.ptr is own


def test_a_copy_of_a_shared_model_is_shared_and_of_a_private_one_is_not() -> None:
    for make in (copy.copy, copy.deepcopy, wrapper.MjModel.copy):
        model, _ = shared_pair()
        other = make(model)
        assert other._model is model._model
        other.opt.timestep = 0.5
        assert model.opt.timestep == 0.002
        third = make(model)
        third.opt.timestep = 0.25
        assert (model.opt.timestep, other.opt.timestep) == (0.002, 0.5)


def test_reading_the_structure_leaves_a_model_shared_and_cannot_change_it() -> None:
    model, twin = shared_pair()
    for name in ("body_parentid", "geom_bodyid", "jnt_type", "body_dofadr", "tex_type"):
        field = getattr(model, name)
        np.testing.assert_array_equal(field, getattr(twin._model, name))
        with pytest.raises(ValueError, match=f"{name} is part of the model's structure"):
            setattr(model, name, 99)
        if field.size:
            with pytest.raises(ValueError, match="read-only"):
                field[0] = 99
            with pytest.raises(ValueError, match="read-only"):
                field += 1
    assert model._model is twin._model
    np.testing.assert_array_equal(model.body_parentid, [0, 0, 0])


def test_masks_groups_and_colours_can_be_written() -> None:
    model = wrapper.MjModel.from_xml_string(_XML)
    for name in ("geom_contype", "geom_conaffinity", "geom_priority", "geom_group", "geom_rgba"):
        getattr(model, name)[0] = 0
        setattr(model, name, getattr(model, name) * 0)
        assert not getattr(model._model, name).any()


def test_a_passive_model_differs_in_actuation_only() -> None:
    shared = SharedModel(mujoco.MjModel.from_xml_string(_XML))
    passive = shared.passive
    assert shared.passive is passive
    assert passive.opt.disableflags == mujoco.mjtDisableBit.mjDSBL_ACTUATION
    assert not shared.model.opt.disableflags
    passive.opt.disableflags = 0
    assert wrapper.MjModel(passive).to_bytes() == wrapper.MjModel(shared.model).to_bytes()


def test_models_without_textures_are_shared_too_and_copied_before_they_can_be_changed() -> None:
    model = suite.load("humanoid", "stand").physics.model
    first, second = model.without_textures(), model.without_textures()
    assert first._model is second._model is not model._model
    assert first._model.ntexdata == 0
    first.body_pos[:] = 7.0
    assert not np.any(second.body_pos == 7.0)
    assert not np.any(model.body_pos == 7.0)


def test_a_model_that_was_changed_keeps_its_changes_without_textures() -> None:
    for model in (suite.load("humanoid", "stand").physics.model, shared_pair()[0]):
        model.body_mass[1] = 3.25
        light = model.without_textures()
        assert light.body_mass[1] == 3.25
        light.body_mass[1] = 4.0
        assert model.body_mass[1] == 3.25
