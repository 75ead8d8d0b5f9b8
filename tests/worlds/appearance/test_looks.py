"""Tests of limberjack.worlds.appearance.looks."""

import copy
import itertools
import os
import pickle
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from limberjack import suite
from limberjack.rl import control
from limberjack.rl.batch_contract import Batch
from limberjack.rl.batches import batch_of
from limberjack.utils import png
from limberjack.worlds.appearance import Appearance, Looks
from tests.plain_pictures import draw_plainly
from tests.representatives import REPRESENTATIVES, Task
from tests.small_sky import small_sky

_draws = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="MUJOCO_GL turns rendering off"
)
_EVERYTHING = {
    "background": "noise",
    "colors": 0.3,
    "camera": 0.3,
    "rotate": "hard",
    "shift": "easy",
    "dynamic": True,
    "interval": 2,
}
_PIXELS = {"camera": 0, "height": 20, "width": 24, "frame_stack": 2}
_STEPS = 5  # in an episode
_WALKER, _REACHER = ("walker", "walk"), ("reacher", "easy")


@pytest.fixture(autouse=True)
def _sky() -> Any:
    with small_sky():
        yield


def _single(task: Task = _WALKER, seed: int = 0, **kwargs: Any) -> control.Environment:
    kwargs = {"appearance": _EVERYTHING, "pixels": _PIXELS, **kwargs}
    env = suite.load(*task, {"random": seed, "time_limit": _STEPS * 0.025}, kwargs)
    draw_plainly(env.physics.model)
    return env


def _batch(task: Task = _WALKER, num_envs: int = 3, vectorised: bool | None = None) -> Batch:
    return batch_of(_single(task), num_envs, seed=0, vectorised=vectorised)


def _actions(env: control.Environment, count: int) -> np.ndarray:
    spec = env.action_spec()
    return np.random.RandomState(5).uniform(-1, 1, (count, *spec.shape))


def _pictures(env: control.Environment, count: int) -> list[np.ndarray]:
    """The newest pictures of some steps, that of the first start included."""
    seen = [env.reset().observation["pixels"]]
    seen += [env.step(action).observation["pixels"] for action in _actions(env, count)]
    return [one[..., -3:] for one in seen]


def _look(appearance: Any, seed: int = 0, episodes: int = 1) -> Any:
    looks = Looks(Appearance.of(appearance), 1, 0.01)
    stream = np.random.RandomState(seed)
    for _ in range(episodes):
        looks.begin(0, stream)
    return looks.of(0)


@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_no_number_of_a_task_changes(task: Task) -> None:
    def played(**kwargs: Any) -> list[bytes]:
        env = suite.load(*task, {"random": 3}, kwargs)
        actions, seen = _actions(env, 12), []
        for start in range(3):
            time_step = env.reset()
            for action in actions[4 * start : 4 * start + 4]:
                time_step = env.step(action)
                seen.append(np.float64(time_step.reward).tobytes())
                seen += [np.asarray(one).tobytes() for one in time_step.observation.values()]
                seen.append(env.physics.get_state().tobytes())
        stream: np.random.RandomState = env.task.random
        return [*seen, stream.bytes(8)]

    assert played(appearance=_EVERYTHING) == played()


def test_the_models_stay_shared_and_unchanged() -> None:
    one, other = _loaded_twice()
    one.reset()
    if os.environ.get("MUJOCO_GL") != "disable":
        one.physics.render(8, 8, 0)
    assert one.physics.model._official is other.physics.model._official
    assert one.physics.identity() == other.physics.identity()


def _loaded_twice() -> tuple[control.Environment, control.Environment]:
    first, second = (
        suite.load(*_WALKER, {"random": 0}, kwargs) for kwargs in ({"appearance": _EVERYTHING}, {})
    )
    return first, second


@_draws
@pytest.mark.parametrize(
    ("task", "vectorised"), [(_WALKER, True), (_REACHER, True), (_WALKER, False)]
)
def test_rows_look_as_single_environments_also_in_later_episodes(
    task: Task, vectorised: bool
) -> None:
    batch, count = _batch(task, vectorised=vectorised), 2 * _STEPS + 2
    actions = _actions(_single(task), count)
    seen = [batch.reset().observation["pixels"]]
    seen += [batch.step(np.tile(one, (3, 1))).observation["pixels"] for one in actions]
    for row in range(3):
        expected = _pictures(_single(task, row), count)
        for pictures, picture in zip(seen, expected, strict=True):
            assert_array_equal(pictures[row][..., -3:], picture)
    assert not np.array_equal(seen[0][0], seen[0][1])


@_draws
def test_a_reset_of_one_row_gives_it_a_new_look_and_leaves_the_others_alone() -> None:
    batch, other = _batch(num_envs=2), _batch(num_envs=2)
    for one in (batch, other):
        one.reset()
    batch.reset([1])
    size = {"height": 12, "width": 12, "camera_id": 0}
    assert_array_equal(batch.render([0], **size), other.render([0], **size))
    assert not np.array_equal(batch.render([1], **size), other.render([1], **size))
    batch.reset([1], [7])
    env = _single(seed=7)
    env.reset()
    assert_array_equal(batch.render([1], **size)[0], env.physics.render(**size))


@_draws
def test_a_snapshot_continues_with_the_same_pictures() -> None:
    env = _single()
    env.reset()
    action = _actions(env, 1)[0]
    for _ in range(3):
        env.step(action)
    saved = pickle.loads(pickle.dumps(env.snapshot()))
    expected = _continued(env, action)
    fresh, batch = _single(seed=9), _batch()
    fresh.restore(saved)
    assert_array_equal(_continued(fresh, action), expected)
    env.restore(saved)  # again, at an earlier time than the look has reached
    assert_array_equal(_continued(env, action), expected)
    batch.reset()
    batch.restore(saved, [2])
    rows = [batch.step(np.tile(action, (3, 1))).observation["pixels"][2] for _ in range(4)]
    assert_array_equal(rows, expected)


@_draws
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_continues_with_the_same_pictures(copied: Any) -> None:
    for env in (_single(), _batch(num_envs=1)):
        env.reset()
        action = np.reshape(_actions(_single(), 1), env.action_spec().shape)
        env.step(action)
        other = copied(env)
        assert_array_equal(_drawn(other), _drawn(env))
        assert_array_equal(_continued(other, action), _continued(env, action))


def _drawn(env: Any) -> np.ndarray:
    size: dict[str, Any] = {"height": 12, "width": 12, "camera_id": 0}
    return env.render(**size) if isinstance(env, Batch) else env.physics.render(**size)


def _continued(env: Any, action: np.ndarray) -> list[np.ndarray]:
    return [env.step(action).observation["pixels"] for _ in range(4)]


def test_a_snapshot_of_another_appearance_is_refused() -> None:
    env = _single(pixels=None)
    other = _single(appearance="color_hard", pixels=None)
    plain = _single(appearance=None, pixels=None)
    for one in (env, other, plain):
        one.reset()
    for one in (other, plain):
        with pytest.raises(ValueError, match="the snapshot is of world"):
            env.restore(one.snapshot())
        with pytest.raises(ValueError, match="the snapshot is of world"):
            one.restore(env.snapshot())


def test_a_new_stream_begins_anew_and_an_old_one_goes_on() -> None:
    env = _single(pixels=None)
    looks: Looks = env._ours.looks  # pyright: ignore[reportAssignmentType]
    env.reset()
    first = looks.save(None)
    env.reset()
    second = looks.save(None)
    assert_array_equal(first["look"], second["look"])
    assert (first["look_episode"], second["look_episode"]) == (0, 1)
    env.reseed(0)
    env.reset()
    assert_array_equal(looks.save(None)["look"], first["look"])
    assert looks.save(None)["look_episode"] == 0
    env.task._random = np.random.RandomState(1)
    env.reset()
    assert not np.array_equal(looks.save(None)["look"], first["look"])


def test_looks_depend_on_seed_and_episode() -> None:
    materials = np.full((3, 3), 0.5)

    def drawn(seed: int, episodes: int) -> bytes:
        return _look({"colors": 0.2}, seed, episodes).colors(materials, 0.0).tobytes()

    assert drawn(0, 1) == drawn(0, 1)
    assert len({drawn(seed, episodes) for seed in (0, 1) for episodes in (1, 2, 3)}) == 6


def test_what_moves_changes_at_every_interval_and_can_go_back_in_time() -> None:
    look = _look({"colors": 0.2, "dynamic": ["colors"], "interval": 3})
    materials = np.full((2, 3), 0.5)
    seen = [look.colors(materials, 0.01 * step).copy() for step in range(8)]
    are_new = [not np.array_equal(*pair) for pair in itertools.pairwise(seen)]
    assert are_new == [False, False, True, False, False, True, False]
    assert_array_equal(look.colors(materials, 0.03), seen[3])
    other = materials + 0.1  # such as the colours that show the reward
    assert (np.abs(look.colors(other, 0.0) - 0.6) <= 0.2).all()


def test_a_relative_path_is_of_the_directory_where_it_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = []
    for folder in ("one", "two"):
        (tmp_path / folder / "x").mkdir(parents=True)
        picture = np.full((6, 8, 3), len(looks), np.uint8)
        (tmp_path / folder / "x" / "1.png").write_bytes(png.encode(picture))
        monkeypatch.chdir(tmp_path / folder / "x")
        looks.append(Looks(Appearance.of({"background": "images:."}), 1, 0.02))
    monkeypatch.chdir(tmp_path)
    rows = [Looks.of_rows(one, 2) for one in looks]
    assert [one.clips[0].frame(0)[0, 0, 0] for one in rows if one is not None] == [0, 1]
    described = [one.as_json() for one in looks]
    assert [one["background"] for one in described] == ["images:x", "images:x"]
    assert described[0]["files"] != described[1]["files"]
    with pytest.raises(ValueError, match=r"does not exist; .*: run this where the folder is$"):
        Looks(Appearance.of(described[0]), 1, 0.02)
    monkeypatch.chdir(tmp_path / "one")
    assert Looks(Appearance.of(described[0]), 1, 0.02).as_json() == described[0]


def test_videos_in_turn_are_those_of_the_next_episodes(tmp_path: Any) -> None:
    from tests.worlds.appearance.test_media import _video

    for number in range(3):
        _video(tmp_path / f"video{number}.mp4", [number * 100] * 2)
    given = {"preset": "video_easy_scene", "background": f"video:{tmp_path}"}
    looks, stream = Looks(Appearance.of(given), 1, 0.01), np.random.RandomState(0)
    seen = []
    for _ in range(4):
        looks.begin(0, stream)
        look = looks.of(0)
        assert look is not None
        frame = look.background(0.0)
        assert frame is not None
        seen.append(round(int(frame[0, 0, 0]) / 100))
    assert sorted(seen[:3]) == [0, 1, 2]
    assert seen == [(seen[0] + number) % 3 for number in range(4)]


@_draws
@pytest.mark.parametrize("vectorised", [None, False])
def test_every_loader_takes_an_appearance(vectorised: bool | None) -> None:
    pixels = {"camera": 0, "height": 12, "width": 12, "only": True}
    how: dict[str, Any] = {"appearance": "rotate_hard"}
    of_batch: dict[str, Any] = {"vectorised": vectorised, **how}
    kwargs = {"pixels": pixels}
    env = suite.load(*_REACHER, {"random": 3}, kwargs, **how)
    picture = env.reset().observation["pixels"]
    plain = suite.load(*_REACHER, {"random": 3}, kwargs)
    assert not np.array_equal(plain.reset().observation["pixels"], picture)
    batch = suite.load_batch(*_REACHER, 2, seed=2, environment_kwargs=kwargs, **of_batch)
    assert_array_equal(batch.reset().observation["pixels"][1], picture)
    single = gymnasium.make("limberjack/reacher-easy-v0", pixels=pixels, **how)
    assert_array_equal(single.reset(seed=3)[0], picture)
    envs = gymnasium.make_vec("limberjack/reacher-easy-v0", num_envs=2, pixels=pixels, **of_batch)
    assert_array_equal(envs.reset(seed=2)[0][1], picture)
    many = suite.load_batch(["reacher:easy"], rows=2, seed=2, **of_batch)
    many.reset()
    size = {"height": 12, "width": 12, "camera_id": 0}
    assert_array_equal(many.render([1], **size)[0], picture)
    with pytest.raises(TypeError, match="appearance is given twice"):
        suite.load(*_REACHER, environment_kwargs=how, **how)


@pytest.mark.parametrize(
    ("appearance", "error", "message"),
    [
        ({"background": "images:/nowhere"}, ValueError, "images:/nowhere, which does not exist"),
        ({"background": "images:~nobody-here/x"}, ValueError, "here/x, which does not exist"),
        ("color_hrad", ValueError, "Did you mean 'color_hard'"),
        ({"colour": 1}, TypeError, "no option 'colour'. Did you mean 'colors'"),
    ],
)
def test_an_environment_refuses_what_it_cannot_show(
    appearance: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        _single(appearance=appearance)


def test_a_model_without_a_sky_has_no_background_and_one_without_materials_no_colors() -> None:
    from limberjack.mujoco import Physics

    physics = Physics.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
    with pytest.raises(ValueError, match="the model has no sky"):
        Looks.for_physics({"background": "noise"}, physics, 1, 0.01)
    with pytest.raises(ValueError, match="the model has no material"):
        Looks.for_physics({"colors": "hard"}, physics, 1, 0.01)
    assert Looks.for_physics({"camera": 0.1}, physics, 1, 0.01) is not None
    assert Looks.for_physics(None, physics, 1, 0.01) is None
    with pytest.raises(TypeError, match="a int cannot be rendered"):
        Looks.for_physics({"colors": 0.1}, 3, 1, 0.01)
