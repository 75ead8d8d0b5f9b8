"""Pictures of a batch equal those of single environments, whatever differs between the rows."""

import os
from typing import Any

import mujoco
import numpy as np
import pytest

from limberjack import suite
from limberjack.mujoco.wrapper import MjvOption
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.control import Environment
from limberjack.rl.randomize import scale, shift
from tests.plain_pictures import draw_plainly
from tests.representatives import REPRESENTATIVES

_draws = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="MUJOCO_GL turns rendering off"
)
_SIZE: dict[str, Any] = {"height": 18, "width": 24}
_TASKS = pytest.mark.parametrize("task", REPRESENTATIVES)


def _batch(
    num_envs: int = 3, task: tuple[str, str] = ("manipulator", "bring_peg"), **kwargs: Any
) -> BatchEnvironment:
    env = suite.load(*task, {"random": 7}, kwargs)
    draw_plainly(env.physics.model)
    batch = BatchEnvironment.from_environment(env, num_envs, 2, seed=7)
    batch.reset()
    return batch


def _single(row: int, task: tuple[str, str] = ("manipulator", "bring_peg"), **kwargs: Any) -> Any:
    env = suite.load(*task, {"random": 7 + row}, kwargs)
    draw_plainly(env.physics.model)
    env.reset()
    return env


def _assert_pictures_alike(batch: BatchEnvironment, singles: list[Environment], **how: Any) -> None:
    """Compares rows' pictures with those of single environments, at the start and later."""
    actions = np.random.RandomState(1).uniform(-1, 1, (3, *batch.action_spec().shape))
    pictures = []
    for action in actions:
        pictures.append(batch.render(range(len(singles)), **how))
        batch.step(action)
    for row, single in enumerate(singles):  # models that are drawn in turn take longer
        for picture, action in zip(pictures, actions, strict=True):
            np.testing.assert_array_equal(picture[row], single.physics.render(**how))
            single.step(action[row])


# Laws.


@_draws
@_TASKS
def test_pictures_of_rows_are_those_of_single_environments(task: tuple[str, str]) -> None:
    singles = [_single(row, task) for row in range(2)]
    _assert_pictures_alike(_batch(2, task), singles, **_SIZE, camera_id=0)


@_draws
@pytest.mark.parametrize("num_envs", [2, 130])
@pytest.mark.parametrize("legacy_step", [True, False])
def test_pictures_do_not_depend_on_how_the_rows_are_kept(num_envs: int, legacy_step: bool) -> None:
    batch = _batch(num_envs, legacy_step=legacy_step)
    singles = [_single(row, legacy_step=legacy_step) for row in range(2)]
    _assert_pictures_alike(batch, singles, **_SIZE, camera_id=0)


@_draws
@pytest.mark.parametrize(
    "randomize",
    [
        {"geom_rgba": lambda random, nominal: random.uniform(size=nominal.shape)},
        {"cam_pos": shift(-0.3, 0.3), "cam_fovy": scale(0.7, 1.2)},
        {"body_mass": scale(0.2, 3.0)},  # that a camera's centre of mass depends on
        {"light_pos": shift(-2.0, 2.0), "site_rgba": scale(0.0, 1.0)},
    ],
    ids=lambda randomize: "-".join(randomize),
)
@pytest.mark.parametrize("task", [("humanoid", "walk"), ("manipulator", "bring_ball")])
def test_per_row_model_fields_are_visible(task: tuple[str, str], randomize: Any) -> None:
    batch = _batch(3, task, randomize=randomize)
    singles = [_single(row, task, randomize=randomize) for row in range(3)]
    how: dict[str, Any] = {"height": 40, "width": 60, "camera_id": 0}
    _assert_pictures_alike(batch, singles, **how)


@_draws
def test_each_row_shows_its_own_target() -> None:
    batch = _batch(3, ("manipulator", "bring_peg"))
    target = batch.physics.model.name2id("target_peg", "body")
    how = {"height": 60, "width": 80, "camera_id": 0, "segmentation": True}
    bodies = batch.physics.model.geom_bodyid[batch.render(**how)[..., 0]]
    places = [np.argwhere(one == target) for one in bodies]
    assert all(place.size for place in places)
    assert len({place.tobytes() for place in places}) == 3


@_draws
def test_distances_object_numbers_and_options_are_those_of_single_environments() -> None:
    option = MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_CONTACTPOINT] = True
    option.flags[mujoco.mjtVisFlag.mjVIS_JOINT] = True
    for how in (
        {"depth": True},
        {"segmentation": True},
        {"scene_option": option, "render_flag_overrides": {"wireframe": True}},
    ):
        batch, singles = _batch(2), [_single(row) for row in range(2)]
        _assert_pictures_alike(batch, singles, **_SIZE, camera_id="fixed", **how)


@_draws
def test_a_batch_that_is_drawn_has_the_future_of_one_that_is_not() -> None:
    randomize = {"body_mass": scale(0.5, 2.0)}
    drawn, twin = (_batch(3, ("stacker", "stack_2"), randomize=randomize) for _ in range(2))
    actions = np.random.RandomState(0).uniform(-1, 1, (8, *drawn.action_spec().shape))
    for step, action in enumerate(actions):
        drawn.render([0, 2], **_SIZE)
        one, other = drawn.step(action), twin.step(action)
        for name, values in one.observation.items():
            np.testing.assert_array_equal(values, other.observation[name])
        if step == 4:
            drawn.reset([1])
            twin.reset([1])
            drawn.render(**_SIZE, depth=True)
    ours, theirs = drawn.snapshot(), twin.snapshot()
    for name, values in ours.physics.items():
        np.testing.assert_array_equal(values, theirs.physics[name])


# Rows and arguments.


@_draws
def test_rows_are_chosen_by_number_or_mask() -> None:
    batch = _batch(3)
    pictures = batch.render(camera="fixed", **_SIZE)
    assert pictures.shape == (3, 18, 24, 3)
    assert pictures.dtype == np.uint8
    chosen = batch.render([0, 2], camera="fixed", **_SIZE)
    np.testing.assert_array_equal(chosen, pictures[[0, 2]])
    mask = np.array([False, True, False])
    np.testing.assert_array_equal(batch.render(mask, camera_id=0, **_SIZE), pictures[1:2])


def test_no_rows_give_no_pictures_of_the_right_shape_without_opengl() -> None:
    batch = _batch(2)
    sizes = {"height": 5, "width": 7}
    for how, shape, dtype in (
        ({}, (0, 5, 7, 3), np.uint8),
        ({"depth": True}, (0, 5, 7), np.float32),
        ({"segmentation": True}, (0, 5, 7, 2), np.int32),
    ):
        pictures = batch.render([], **sizes, **how)
        assert (pictures.shape, pictures.dtype) == (shape, dtype)
    assert batch.render(np.zeros(2, bool)).shape == (0, 240, 320, 3)


@pytest.mark.parametrize("rows", [[2], [-1], [1, 0], [0, 0], [0.5], [[0]], np.ones(3, bool)])
def test_unknown_rows_are_refused(rows: Any) -> None:
    with pytest.raises(ValueError, match="expected"):
        _batch(2).render(rows, **_SIZE)


@pytest.mark.parametrize("rows", [None, []])
@pytest.mark.parametrize(
    ("kwargs", "error", "message"),
    [
        ({"camera": "fixt"}, ValueError, "Did you mean 'fixed'"),
        ({"camera": 9}, ValueError, "camera_id is 9"),
        ({"camera": 0, "camera_id": 0}, TypeError, "camera is given twice"),
        ({"heigth": 9}, TypeError, r"keyword argument 'heigth'\. Did you mean 'height'"),
        ({"height": 0}, ValueError, "image height is 0"),
        ({"width": 10**6}, ValueError, "image width 1000000 > "),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_drawn(
    rows: Any, kwargs: dict[str, Any], error: Any, message: str
) -> None:
    with pytest.raises(error, match=message):
        _batch(2).render(rows, **kwargs)


@_draws
def test_distances_and_object_numbers_cannot_be_had_at_once() -> None:
    with pytest.raises(ValueError, match="cannot both be true"):
        _batch(2).render(depth=True, segmentation=True)


def test_a_closed_batch_has_no_pictures() -> None:
    batch = _batch(2)
    batch.close()
    with pytest.raises(RuntimeError, match="this batch is closed"):
        batch.render(**_SIZE)
