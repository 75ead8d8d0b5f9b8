"""Compiled models are shared between equal sources and cached."""

import gc
import weakref

import mujoco
import pytest

from limberjack import suite
from limberjack.mujoco import compiled as kept_models
from limberjack.mujoco.compiled import compiled

_XML = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"


def _compile() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(_XML)


def test_a_source_is_compiled_once_even_if_the_model_is_unused_in_between() -> None:
    def never() -> mujoco.MjModel:
        raise AssertionError("it was compiled again")

    source = "once", _XML
    number = id(compiled(source, _compile).model)
    gc.collect()
    assert id(compiled(source, never).model) == number


def test_unused_models_are_dropped_when_their_total_size_is_too_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(kept_models, "_last_used", type(kept_models._last_used)())
    size = mujoco.mj_sizeModel(_compile())
    monkeypatch.setattr(kept_models, "_MOST_KEPT", int(2.5 * size))
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
    monkeypatch.setattr(kept_models, "_last_used", {})
    size = mujoco.mj_sizeModel(_compile())
    monkeypatch.setattr(kept_models, "_MOST_KEPT", int(2.5 * size))
    models = [weakref.ref(compiled(("old", i), _compile)) for i in range(2)]
    compiled(("old", 0), _compile)
    compiled(("old", 2), _compile)
    assert [model() is None for model in models] == [False, True]
    monkeypatch.setattr(kept_models, "_MOST_KEPT", size // 2)
    large = weakref.ref(compiled(("large", 0), _compile))
    gc.collect()
    assert large() is not None


def test_a_second_load_compiles_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    for domain, task in suite.ALL_TASKS:
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
