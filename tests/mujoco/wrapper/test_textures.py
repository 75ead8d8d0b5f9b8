"""Tests of limberjack.mujoco.wrapper.textures."""

import copy
import tracemalloc

import mujoco
import mujoco.batch
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco.wrapper import textures
from limberjack.mujoco.wrapper.textures import with_textures, without_textures
from tests.representatives import EVERY_TASK

_EVERY_TASK = pytest.mark.parametrize("task", EVERY_TASK)
_CUT = {"ntexdata", "nbuffer", "tex_data", "tex_height", "tex_width", "tex_adr"}
# Fields about the source of a model, which models in binary format lack.
_CUT |= {"signature"}


def _model(task: tuple[str, str]) -> mujoco.MjModel:
    return suite.load(*task, {"random": 0}).physics.model._official


def _values(model: mujoco.MjModel) -> dict[str, object]:
    """All fields of a model by name; structs as text."""
    found: dict[str, object] = {}
    for name in dir(model):
        value = getattr(model, name)
        if name.startswith("_") or name in _CUT or callable(value):
            continue
        if isinstance(value, np.ndarray):
            found[name] = value.dtype, value.shape, value.tobytes()
        elif isinstance(value, int | float | bytes):
            found[name] = value
    return found | {name: repr(getattr(model, name)) for name in ("opt", "vis", "stat")}


@_EVERY_TASK
def test_a_model_without_textures_is_the_same_otherwise(task: tuple[str, str]) -> None:
    model = _model(task)
    light = without_textures(model)
    assert mujoco.mj_sizeModel(light) < 0.05 * mujoco.mj_sizeModel(model)
    assert _values(light) == _values(model)
    assert light.ntexdata == light.tex_data.size == 0
    assert light.ntex == model.ntex
    for name in ("tex_height", "tex_width", "tex_adr"):
        assert not getattr(light, name).any()


@_EVERY_TASK
@pytest.mark.parametrize("persistent", [True, False])
def test_simulations_without_textures_are_the_same_in_every_bit(
    task: tuple[str, str], persistent: bool
) -> None:
    model = _model(task)
    states = []
    for each in (model, without_textures(model)):
        batch = mujoco.batch.Batch(each, 3, 2, persistent=persistent)
        sensors = batch.bind("sensordata")
        batch.bind("ctrl")[...] = np.random.RandomState(0).uniform(-1, 1, (3, model.nu))
        batch.step(None, 50)
        states.append((batch.state.tobytes(), sensors.tobytes()))
    assert states[0] == states[1]


def test_the_model_is_left_as_it_was_and_nothing_is_shared() -> None:
    model = _model(("manipulator", "bring_ball"))
    before = copy.copy(model)
    light = without_textures(model)
    light.body_pos[:] = 7.0
    light.mat_rgba[:] = 7.0
    assert _values(model) == _values(before)
    np.testing.assert_array_equal(model.tex_data, before.tex_data)


def test_edits_are_kept() -> None:
    model = copy.copy(_model(("stacker", "stack_2")))
    model.body_mass[1] = 3.5
    model.opt.timestep = 0.007
    model.vis.map.znear = 0.5
    light = without_textures(model)
    assert light is not model
    assert _values(light) == _values(model)


@pytest.mark.parametrize(
    "texture", ["", '<texture name="t" type="2d" builtin="flat" width="9" height="9"/>']
)
def test_a_model_with_small_textures_is_returned_unchanged(texture: str) -> None:
    xml = f"<mujoco><asset>{texture}</asset><worldbody><geom size='.1'/></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    assert without_textures(model) is model


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("_BEFORE_DATA", ("tex_height", "tex_adr")),
        ("_SIZE", np.dtype("i4")),
        ("_ALIGNMENT", 2**16),
        ("_is_like", lambda made, model: False),
    ],
)
def test_a_model_with_another_layout_is_returned_unchanged(
    monkeypatch: pytest.MonkeyPatch, name: str, value: object
) -> None:
    model = _model(("humanoid", "stand"))
    monkeypatch.setattr(textures, name, value)
    assert without_textures(model) is model


def test_other_textures_take_the_place_of_the_models() -> None:
    model = _model(("walker", "walk"))
    sky = np.random.RandomState(0).randint(0, 256, (16, 16, 3)).astype(np.uint8)
    made = with_textures(model, {0: sky})
    assert _values(made) == _values(model)
    assert made.tex_height.tolist() == [16, model.tex_height[1]]
    assert made.tex_width.tolist() == [16, model.tex_width[1]]
    np.testing.assert_array_equal(made.tex_data[: sky.size], sky.ravel())
    floor = model.tex_data[model.tex_adr[1] :]
    np.testing.assert_array_equal(made.tex_data[made.tex_adr[1] :], floor)
    assert made.ntexdata == sky.size + floor.size
    assert mujoco.mj_sizeModel(made) < 0.05 * mujoco.mj_sizeModel(model)


def test_a_model_with_another_layout_gets_no_other_textures(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(textures, "_SIZE", np.dtype("i4"))
    with pytest.raises(RuntimeError, match="keeps textures in another place"):
        with_textures(_model(("walker", "walk")), {0: np.zeros((8, 8, 3), np.uint8)})


def test_no_copy_of_the_textures_remains_in_the_heap() -> None:
    # Blocks of the size of a sky fragment the heap: 51 tasks in one batch then take 30 MB more.
    model = _model(("reacher", "easy"))
    tracemalloc.start()
    try:
        light = without_textures(model)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert light is not model
    assert peak < 0.1 * model.ntexdata
