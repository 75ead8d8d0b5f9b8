"""Compiled models are shared, cached, and copied before they can be changed."""

import copy
import gc
import weakref
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco import wrapper
from limberjack.mujoco.wrapper import sharing
from limberjack.mujoco.wrapper.sharing import SharedModel, compiled

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
    assert model._official is twin._official


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
    shared = twin._official
    touch(model)
    own = model._official
    assert own is not shared
    assert twin._official is shared
    touch(model)
    assert model._official is own
    assert model.ptr is own


def test_a_copy_of_a_shared_model_is_shared_and_of_a_private_one_is_not() -> None:
    for make in (copy.copy, copy.deepcopy, wrapper.MjModel.copy):
        model, _ = shared_pair()
        other = make(model)
        assert other._official is model._official
        other.opt.timestep = 0.5
        assert model.opt.timestep == 0.002
        third = make(model)
        third.opt.timestep = 0.25
        assert (model.opt.timestep, other.opt.timestep) == (0.002, 0.5)


def test_reading_the_structure_leaves_a_model_shared_and_cannot_change_it() -> None:
    model, twin = shared_pair()
    for name in ("body_parentid", "geom_bodyid", "jnt_type", "body_dofadr", "tex_type"):
        field = getattr(model, name)
        np.testing.assert_array_equal(field, getattr(twin._official, name))
        with pytest.raises(ValueError, match=f"{name} is part of the model's structure"):
            setattr(model, name, 99)
        if field.size:
            with pytest.raises(ValueError, match="read-only"):
                field[0] = 99
            with pytest.raises(ValueError, match="read-only"):
                field += 1
    assert model._official is twin._official
    np.testing.assert_array_equal(model.body_parentid, [0, 0, 0])


def test_masks_groups_and_colours_can_be_written() -> None:
    model = wrapper.MjModel.from_xml_string(_XML)
    for name in ("geom_contype", "geom_conaffinity", "geom_priority", "geom_group", "geom_rgba"):
        getattr(model, name)[0] = 0
        setattr(model, name, getattr(model, name) * 0)
        assert not getattr(model._official, name).any()


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
    assert first._official is second._official is not model._official
    assert first._official.ntexdata == 0
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


_FREE = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


def _compile() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_FREE)


def test_a_source_is_compiled_once_even_if_the_model_is_unused_in_between() -> None:
    def never() -> mujoco.MjModel:
        raise AssertionError("it was compiled again")

    source = "once", _FREE
    number = id(compiled(source, _compile).model)
    gc.collect()
    assert id(compiled(source, never).model) == number


def test_unused_models_are_dropped_when_their_total_size_is_too_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sharing, "_last_used", type(sharing._last_used)())
    size = mujoco.mj_sizeModel(_compile())
    monkeypatch.setattr(sharing, "_MOST_KEPT", int(2.5 * size))
    models = [weakref.ref(compiled(("many", i), _compile)) for i in range(3)]
    assert [model() is None for model in models] == [True, False, False]
    kept = compiled(("many", 1), _compile)
    assert kept is models[1]()
    compiled(("many", 3), _compile)
    assert compiled(("many", 1), _compile) is kept  # still in use, so still shared
    assert models[2]() is None


def test_the_model_used_longest_ago_is_dropped_first_and_the_last_one_never(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sharing, "_last_used", {})
    size = mujoco.mj_sizeModel(_compile())
    monkeypatch.setattr(sharing, "_MOST_KEPT", int(2.5 * size))
    models = [weakref.ref(compiled(("old", i), _compile)) for i in range(2)]
    compiled(("old", 0), _compile)
    compiled(("old", 2), _compile)
    assert [model() is None for model in models] == [False, True]
    monkeypatch.setattr(sharing, "_MOST_KEPT", size // 2)
    large = weakref.ref(compiled(("large", 0), _compile))
    gc.collect()
    assert large() is not None


def test_a_second_load_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for domain, task in dict(suite.ALL_TASKS).items():  # the last task of each domain
        suite.load(domain, task).close()
        with monkeypatch.context() as patch:
            patch.delattr(mujoco.MjModel, "from_xml_string")
            suite.load(domain, task).close()


def test_removed_textures_cannot_be_read_or_changed() -> None:
    physics = suite.load("humanoid", "stand").physics
    light = type(physics).from_model(physics.model.without_textures())
    for model in (light.model, light.named.model):
        with pytest.raises(ValueError, match="without textures: the start of an episode cannot"):
            model.tex_data[:] = 0
    assert physics.model.tex_data.size


def test_a_model_counts_as_lent_once_user_code_can_change_what_is_drawn() -> None:
    physics = suite.load("manipulator", "bring_ball").physics
    physics.named.model.body_pos["target_ball", "x"] = 0.1
    physics.model.opt.timestep = 0.001
    assert physics.model._shared is None
    assert not physics.model._is_lent
    assert physics.named.model.tex_data.size
    assert physics.model._is_lent
    for touch in (lambda m: m.ptr, lambda m: m.mesh_vert, lambda m: m.tex("skybox")):
        model = suite.load("manipulator", "bring_ball").physics.model
        touch(model)
        assert model._is_lent


def test_the_model_by_dm_controls_private_name_belongs_to_its_physics_alone() -> None:
    """Programs for dm_control write `physics.model._model` where they need the official struct."""
    first, other = (suite.load("walker", "walk", {"random": 0}).physics for _ in range(2))
    model: Any = first.model._model
    model.opt.gravity[2] = -1.62
    assert first.model.opt.gravity[2] == -1.62
    assert other.model.opt.gravity[2] == -9.81
    assert suite.load("walker", "walk").physics.model.opt.gravity[2] == -9.81
    first.model.body_mass[1] = 7.0
    assert model.body_mass[1] == 7.0
    assert model is first.model.ptr
