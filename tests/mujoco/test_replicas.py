"""Rows of replicas begin, step and render like single simulations of the same model."""

import functools
import os
import threading
from typing import Any

import numpy as np
import pytest

from limberjack.mujoco import Physics
from limberjack.mujoco.rendering import thread
from limberjack.mujoco.simulation import STATE
from limberjack.rl.contract import PhysicsError

from .furnished import SIZE, furnished

_draws = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="MUJOCO_GL turns rendering off"
)
_NUM_ENVS = 3
_XML = """
<mujoco>
  <option timestep="0.01"/>
  <asset><texture name="sky" type="skybox" builtin="gradient" width="128" height="768"/></asset>
  <worldbody>
    <body name="pole">
      <joint name="hinge" axis="0 1 0" damping=".1"/>
      <geom name="rod" size=".1" pos=".5 0 0" mass="2"/>
      <site name="tip" pos="1 0 0"/>
    </body>
  </worldbody>
  <actuator><motor name="torque" joint="hinge"/></actuator>
  <sensor><velocimeter name="speed" site="tip"/></sensor>
</mujoco>
"""


class _Pole(Physics):
    def tip_height(self) -> np.ndarray:
        return self.named.data.site_xpos["tip", "z"]


def _begin(one: Any, row: int) -> None:
    """Sets a different start for each row."""
    one.named.data.qpos["hinge"] = 0.3 * row
    one.data.qvel[0] = -1.0 * row
    one.named.model.body_mass["pole"] = 2.0 + row


def _pair(legacy_step: bool = True) -> tuple[Any, list[_Pole]]:
    """Replicas whose episodes have begun, and single simulations that began alike."""
    singles = [_Pole.from_xml_string(_XML) for _ in range(_NUM_ENVS)]
    for single in singles:
        single.legacy_step = legacy_step
    rows = singles[0].replicate(_NUM_ENVS, 2, ("body_mass",))
    for row, single in enumerate(singles):
        with rows.episode(row) as one:
            _begin(one, row)
        _begin(single, row)
        single.after_reset()
    rows.start(np.arange(_NUM_ENVS))
    return rows, singles


def _assert_alike(rows: Any, singles: list[_Pole]) -> None:
    for row, single in enumerate(singles):
        for name in ("qpos", "qvel", "time", "sensordata", "site_xpos", "qfrc_actuator"):
            expected = getattr(single.data, name)
            np.testing.assert_array_equal(getattr(rows.physics.data, name)[row], expected, name)
        assert rows.physics.tip_height()[row] == single.tip_height()


@pytest.mark.parametrize("legacy_step", [True, False])
def test_rows_begin_and_step_as_single_simulations(legacy_step: bool) -> None:
    rows, singles = _pair(legacy_step)
    _assert_alike(rows, singles)
    for step in range(4):
        for row, single in enumerate(singles):
            rows.physics.data.ctrl[row] = single.data.ctrl[0] = 0.2 * row + step
            single.step(3)
        assert not rows.step(None, 3).any()
        _assert_alike(rows, singles)


def test_the_physics_are_of_the_same_class_and_run_alike() -> None:
    physics = _Pole.from_xml_string(_XML)
    physics.legacy_step = False
    physics.recompute_constants_of(["body_mass"])
    rows = physics.replicate(_NUM_ENVS, 1, ())
    for each in (rows.physics, rows.single, rows.textured):
        assert type(each) is _Pole
        assert each.legacy_step is False
        assert each.simulation.sets_constants
    assert rows.physics.num_envs == _NUM_ENVS
    assert rows.single.num_envs is None
    assert rows.single.model.ntexdata == 0 < rows.textured.model.ntexdata
    assert rows.physics.tip_height().shape == (_NUM_ENVS,)


def test_replicas_begin_in_the_default_state_and_leave_the_physics_alone() -> None:
    physics = _Pole.from_xml_string(_XML)
    physics.data.qpos[0] = 0.7
    physics.step(5)
    before = physics.get_state(STATE)
    rows = physics.replicate(_NUM_ENVS, 1, ("body_mass",))
    np.testing.assert_array_equal(rows.physics.data.qpos, np.zeros((_NUM_ENVS, 1)))
    with rows.episode(1) as one:
        _begin(one, 1)
    rows.step(None, 2)
    rows.physics.model.body_mass[:] = 9.0
    np.testing.assert_array_equal(physics.get_state(STATE), before)
    assert physics.model.body_mass[1] == 2.0


def test_only_the_given_rows_advance() -> None:
    rows, singles = _pair()
    singles[2].step(4)
    rows.step(np.array([2]), 4)
    _assert_alike(rows, singles)


def test_an_episode_changes_its_own_row_alone() -> None:
    rows, _ = _pair()
    rows.step(None, 3)
    state, mass = rows.simulation.state.copy(), rows.physics.model.body_mass.copy()
    with rows.episode(1) as one:
        one.data.qpos[0] = -0.5
        one.named.model.body_mass["pole"] = 5.0
    others = [0, 2]
    np.testing.assert_array_equal(rows.simulation.state[others], state[others])
    np.testing.assert_array_equal(rows.physics.model.body_mass[others], mass[others])
    assert rows.physics.data.qpos[1, 0] == -0.5
    assert rows.physics.model.body_mass[1, 1] == 5.0


def test_an_episode_begins_reset_and_with_the_rows_own_fields() -> None:
    rows, _ = _pair()
    rows.step(None, 3)
    with rows.episode(1) as one:  # after that of row 2
        assert one is rows.single
        assert (one.data.qpos[0], one.data.qvel[0], one.time()) == (0.0, 0.0, 0.0)
        assert one.model.body_mass[1] == 3.0


def test_an_episode_that_fails_leaves_its_row_as_it_was() -> None:
    rows, _ = _pair()
    rows.step(None, 3)
    state = rows.simulation.state.copy()
    with pytest.raises(ZeroDivisionError), rows.episode(1) as one:
        one.data.qpos[0] = 1 / 0
    np.testing.assert_array_equal(rows.simulation.state, state)


def test_a_row_that_diverges_is_reported_and_the_others_continue() -> None:
    rows, singles = _pair()
    rows.physics.data.qvel[1] = np.nan
    assert rows.step(None, 2).tolist() == [False, True, False]
    for row in (0, 2):
        singles[row].step(2)
        assert rows.physics.data.qpos[row] == singles[row].data.qpos
    assert rows.step(None, 2).tolist() == [False] * _NUM_ENVS  # MuJoCo has reset the row


def test_a_row_that_is_shown_has_its_state_and_its_own_fields() -> None:
    rows, singles = _pair()
    rows.step(None, 5)
    for row, single in enumerate(singles):
        single.step(5)
        shown = rows.shown(row)
        assert shown is rows.textured
        assert shown.tip_height() == single.tip_height()
        assert shown.model.body_mass[1] == single.model.body_mass[1]


@_draws
def test_pictures_of_rows_are_those_of_single_simulations() -> None:
    physics = furnished()
    rows = physics.replicate(2, 1, ())
    for row in range(2):
        with rows.episode(row) as one:
            one.named.data.qpos["hinge"] = 0.4 * row
    rows.start(np.arange(2))
    how = {**SIZE, "camera_id": "wall"}
    pictures = rows.render_rows(None, **how)
    for row in range(2):
        single = furnished()
        single.reset()
        single.named.data.qpos["hinge"] = 0.4 * row
        single.forward()
        np.testing.assert_array_equal(pictures[row], single.render(**how))
    np.testing.assert_array_equal(rows.render_rows(np.array([1]), **how), pictures[1:])


@_draws
def test_each_row_is_drawn_with_its_own_terrain_in_each_episode() -> None:
    rows = furnished().replicate(2, 1, ("hfield_data",))
    how = {**SIZE, "camera_id": "wall"}
    for episode in range(2):
        heights = np.random.RandomState(episode).uniform(size=(2, 9))
        for row in range(2):
            with rows.episode(row) as one:
                one.model.hfield_data[:] = heights[row]
        rows.start(np.arange(2))
        pictures = rows.render_rows(None, **how)
        for row in range(2):
            single = furnished()
            single.model.hfield_data[:] = heights[row]
            single.reset()
            np.testing.assert_array_equal(pictures[row], single.render(**how))
        assert (pictures[0] != pictures[1]).any()


@_draws
@pytest.mark.parametrize("cores", [1, 2])
def test_pictures_do_not_depend_on_the_number_of_rendering_threads(
    cores: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(thread, "usable_cores", lambda: cores)
    rows = furnished().replicate(5, 1, ("hfield_data", "geom_rgba"))
    for row in range(5):
        with rows.episode(row) as one:
            one.model.hfield_data[:] = np.random.RandomState(row).uniform(size=9)
            one.model.geom_rgba[:, 0] = 0.1 * row
            one.named.data.qpos["hinge"] = 0.4 * row
    rows.start(np.arange(5))
    several: list[dict[str, Any]] = [{}, {"depth": True}, {"segmentation": True}]
    for how in ({**SIZE, "camera_id": "wall", **one} for one in several):
        expected = [rows.shown(row).render(**how) for row in range(5)]
        assert len({picture.tobytes() for picture in expected}) == 5
        for numbers in (None, np.array([4, 1, 1, 3]), np.array([2])):
            chosen = range(5) if numbers is None else numbers
            pictures = rows.render_rows(numbers, **how)
            np.testing.assert_array_equal(pictures, [expected[row] for row in chosen])


@_draws
def test_an_error_in_one_row_ends_the_pictures_of_the_others_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows = furnished().replicate(5, 1, ())
    rows.start(np.arange(5))
    expected = rows.render_rows(None, **SIZE)
    under_way: list[Any] = []
    begin = Physics.begin_render

    def recorded(one: Any, *given: Any) -> Any:
        under_way.append(begin(one, *given))
        return under_way[-1]

    monkeypatch.setattr(Physics, "begin_render", recorded)
    rows.simulation.state[3, 1] = np.nan
    with pytest.raises(PhysicsError):
        rows.render_rows(None, **SIZE)
    assert [drawing.gi_frame for drawing in under_way] == [None, None]  # all have ended
    rows.simulation.state[3] = rows.simulation.state[2]
    np.testing.assert_array_equal(rows.render_rows(None, **SIZE), expected)


class _Framed(_Pole):
    def render(self, *args: Any, **kwargs: Any) -> np.ndarray:
        return np.full((2, 2, 3), self.data.qpos[0] * 10)


def test_rows_of_a_physics_with_its_own_pictures_are_drawn_by_it() -> None:
    rows = _Framed.from_xml_string(_XML).replicate(4, 1)
    rows.simulation.state[:, 1] = [0.0, 0.1, 0.2, 0.3]
    assert rows.render_rows(None)[:, 0, 0, 0].tolist() == [0.0, 1.0, 2.0, 3.0]


@_draws
def test_a_users_function_sees_one_row_after_the_other() -> None:
    rows = furnished().replicate(4, 1, ())
    for row in range(4):
        with rows.episode(row) as one:
            one.named.data.qpos["hinge"] = 0.4 * row
    rows.start(np.arange(4))
    seen: list[Any] = []

    def look(physics: Any, _: Any) -> None:
        assert physics is rows.textured
        assert threading.current_thread() is threading.main_thread()
        seen.append(physics.named.data.qpos["hinge"].item())

    rows.render_rows(None, **SIZE, scene_callback=look)
    assert seen == pytest.approx([0.0, 0.4, 0.8, 1.2])


def test_pictures_of_no_row_have_their_shape_and_need_no_drawing() -> None:
    rows = furnished().replicate(2, 1, ())
    none = np.empty(0, int)
    assert rows.render_rows(none, **SIZE).shape == (0, 96, 128, 3)
    depth = rows.render_rows(none, **SIZE, depth=True)
    assert (depth.shape, depth.dtype) == ((0, 96, 128), np.float32)
    assert rows.picture_spec(**SIZE) == ((96, 128, 3), np.uint8)
    with pytest.raises(TypeError, match="'hieght'"):
        rows.render_rows(none, hieght=3)


def test_the_physics_of_replicas_that_are_freed_is_closed() -> None:
    rows, _ = _pair()
    every = [rows.physics, rows.single, rows.textured]
    if os.environ.get("MUJOCO_GL") != "disable":
        rows.render_rows(None, height=8, width=8)
        every += rows._also_shown
        assert len(every) > 3
    rows.free()
    rows.free()
    for physics in every:
        with pytest.raises(RuntimeError, match="this Physics is closed"):
            _ = physics.data


class _Measured(_Pole):
    unit = 1.0

    @functools.cached_property
    def heights(self) -> np.ndarray:
        return self.data.site_xpos[..., 2]

    def tip_height(self) -> np.ndarray:
        return super().tip_height() * self.unit


def test_rows_and_episodes_have_a_domains_own_attributes_but_no_cached_ones() -> None:
    physics = _Measured.from_xml_string(_XML)
    physics.unit = 100.0
    assert physics.heights.shape == (1,)
    rows = physics.replicate(_NUM_ENVS, 1)
    for one in (rows.single, rows.textured, rows.physics):
        assert one.unit == 100.0
    assert rows.single.heights.base is not physics.heights.base
    assert rows.physics.heights.shape == (_NUM_ENVS, 1)
