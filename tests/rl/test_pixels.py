"""Pixel observations: their content, and their part in snapshots and copies."""

import collections
import copy
import os
import pickle
from typing import Any

import numpy as np
import pytest

from limberjack import suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.pixels import Frames, Pixels, render_cameras
from limberjack.rl.rows import RowsEnvironment
from limberjack.suite import base
from tests.plain_pictures import draw_plainly
from tests.representatives import REPRESENTATIVES

_draws = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="MUJOCO_GL turns rendering off"
)
_PIXELS = {"camera": 0, "height": 12, "width": 16, "frame_stack": 3}
_BALL = ("manipulator", "bring_ball")
_STEPS = 4  # in an episode


def _limit(task: tuple[str, str]) -> dict[str, float]:
    return {"time_limit": _STEPS * (0.025 if task[0] == "humanoid" else 0.01)}


def _single(
    seed: int = 0, task: tuple[str, str] = _BALL, pixels: Any = _PIXELS, **kwargs: Any
) -> control.Environment:
    env = suite.load(*task, {"random": seed, **_limit(task)}, {"pixels": pixels, **kwargs})
    draw_plainly(env.physics.model)
    return env


def _batch(
    num_envs: int = 3, task: tuple[str, str] = _BALL, pixels: Any = _PIXELS, **kwargs: Any
) -> BatchEnvironment:
    single = _single(0, task, pixels, **kwargs)
    return BatchEnvironment.from_environment(single, num_envs, 2, seed=0)


def _actions(env: Any, steps: int) -> np.ndarray:
    return np.random.RandomState(1).uniform(-1, 1, (steps, *env.action_spec().shape))


def _assert_same(one: Any, other: Any) -> None:
    assert one.observation.keys() == other.observation.keys()
    np.testing.assert_array_equal(one.step_type, other.step_type)
    for name, value in one.observation.items():
        np.testing.assert_array_equal(value, other.observation[name], name)


def _pictures(stack: np.ndarray) -> list[np.ndarray]:
    """The pictures of a stack, the oldest first."""
    return np.split(stack, stack.shape[-1] // 3, axis=-1)


# Content.


@_draws
def test_the_stack_holds_the_last_pictures_and_an_episode_begins_with_its_first() -> None:
    env = _single()
    look = {"height": 12, "width": 16, "camera_id": 0}
    for _ in range(2):
        seen = _pictures(env.reset().observation["pixels"])
        drawn = [env.physics.render(**look)] * 3
        np.testing.assert_array_equal(seen, drawn)
        for action in _actions(env, _STEPS):
            seen = _pictures(env.step(action).observation["pixels"])
            drawn = [*drawn[1:], env.physics.render(**look)]
            np.testing.assert_array_equal(seen, drawn)
        assert not env.is_running
        assert (drawn[0] != drawn[2]).any()


@_draws
@pytest.mark.parametrize("kind", ["single", "vectorised", "rows"])
def test_pictures_drawn_at_every_second_step_are_those_of_repeated_actions(kind: str) -> None:
    repeating = _single()
    repeating.action_repeat = 2
    env: Any = _single()
    if kind == "vectorised":
        env = _batch()
    if kind == "rows":
        env = RowsEnvironment(_single, 3, 1, seed=0)
    env.draw_every(2)
    env = copy.deepcopy(env)
    actions = _actions(repeating, _STEPS // 2)
    for _ in range(2):  # episodes
        expected, time_step = repeating.reset(), env.reset()
        for step in range(_STEPS + 1):
            seen = time_step.observation["pixels"]
            np.testing.assert_array_equal(
                seen[0] if seen.ndim > 3 else seen, expected.observation["pixels"]
            )
            if step == _STEPS:
                break
            action = actions[step // 2]
            time_step = env.step(action if kind == "single" else np.tile(action, (3, 1)))
            if step % 2:
                expected = repeating.step(action)
    with pytest.raises(ValueError, match="steps is 0"):
        env.draw_every(0)


@_draws
@pytest.mark.parametrize("task", REPRESENTATIVES)
def test_rows_observe_the_pixels_of_single_environments_across_episodes(
    task: tuple[str, str],
) -> None:
    batch = _batch(2, task)
    actions = _actions(batch, _STEPS + 3)
    seen = [batch.reset(), *map(batch.step, actions)]
    for row in range(2):  # one after the other: models that are drawn in turn take longer
        single = _single(row, task)
        expected = [single.reset(), *map(single.step, actions[:, row])]
        for batched, alone in zip(seen, expected, strict=True):
            for name, values in batched.observation.items():
                np.testing.assert_array_equal(values[row], alone.observation[name], name)


@_draws
def test_the_state_beside_the_pictures_is_that_without_them() -> None:
    for flat in (False, True):
        env, plain = (_single(pixels=p, flat_observation=flat) for p in (_PIXELS, None))
        batch, plain_batch = (_batch(pixels=p, flat_observation=flat) for p in (_PIXELS, None))
        for one, other in ((env, plain), (batch, plain_batch)):
            seen, known = one.reset().observation, other.reset().observation
            assert type(seen) is type(known)
            assert list(seen) == [*known, "pixels"]
            for name in known:
                np.testing.assert_array_equal(seen[name], known[name])


@_draws
@pytest.mark.parametrize("only", [False, True])
@pytest.mark.parametrize("flat", [False, True])
def test_observations_follow_their_specs(only: bool, flat: bool) -> None:
    pixels = {**_PIXELS, "only": only}
    env, batch = (make(pixels=pixels, flat_observation=flat) for make in (_single, _batch))
    for each, shape in ((env, (12, 16, 9)), (batch, (3, 12, 16, 9))):
        spec, observation = each.observation_spec(), each.reset().observation
        assert list(spec) == list(observation)
        assert (len(spec) == 1) == only
        assert observation["pixels"].shape == shape
        for name, value in observation.items():
            spec[name].validate(value)


@_draws
def test_returned_observations_may_be_modified() -> None:
    for env in (_single(), _batch()):
        kept = env.reset().observation["pixels"]
        expected = kept.copy()
        later = env.step(np.zeros(env.action_spec().shape)).observation["pixels"]
        np.testing.assert_array_equal(kept, expected)
        later[...] = 0
        last = env.step(np.zeros(env.action_spec().shape)).observation["pixels"]
        np.testing.assert_array_equal(last[..., :3], expected[..., :3])
        assert last[..., 3:6].any()


@_draws
@pytest.mark.parametrize("frame_stack", [1, 2])
@pytest.mark.parametrize("quality", ["full", "fast"])
def test_several_cameras_are_channels_of_each_frame_in_their_order(
    frame_stack: int, quality: str
) -> None:
    how = {**_PIXELS, "frame_stack": frame_stack, "quality": quality}
    cameras = [-1, 0, -1]
    several = {**how, "camera": cameras}
    env, batch = _single(1, pixels=several), _batch(2, pixels=several)
    parts = [_single(1, pixels={**how, "camera": camera}) for camera in cameras]
    environments = RowsEnvironment(_single(pixels=several), 2, 1, seed=0)
    begun = _batch(2, pixels=several).reset().observation["pixels"]
    np.testing.assert_array_equal(environments.reset().observation["pixels"], begun)
    assert env.observation_spec()["pixels"].shape == (12, 16, 9 * frame_stack)
    seen, rows = env.reset(), batch.reset()
    expected, pixels = [part.reset() for part in parts], np.empty(0)
    for action in _actions(env, _STEPS + 2):  # across the end of an episode
        pixels = seen.observation["pixels"]
        env.observation_spec()["pixels"].validate(pixels)
        np.testing.assert_array_equal(rows.observation["pixels"][1], pixels)
        frames = np.split(pixels, frame_stack, axis=-1)
        for number in range(3):
            alone = _pictures(expected[number].observation["pixels"])
            for frame, picture in zip(frames, alone, strict=True):
                np.testing.assert_array_equal(_pictures(frame)[number], picture)
        seen, rows = env.step(action), batch.step(np.stack([action, action]))
        expected = [part.step(action) for part in parts]
    assert (_pictures(pixels)[0] != _pictures(pixels)[1]).any()


@_draws
def test_a_list_of_one_camera_is_that_camera() -> None:
    one, other = _single(pixels={**_PIXELS, "camera": [0]}), _single()
    assert one.pixels == other.pixels
    _assert_same(one.reset(), other.reset())
    other.restore(one.snapshot())


@_draws
def test_snapshots_and_copies_hold_the_frames_of_all_cameras() -> None:
    pixels: dict[str, Any] = {**_PIXELS, "camera": [0, -1]}
    for make in (_single, _batch):
        env: Any = make(pixels=pixels)
        pixels["camera"].append(0)  # later changes of the caller's list make no difference
        env.reset()
        actions = _actions(env, 4)
        env.step(actions[0])
        snapshot = pickle.loads(pickle.dumps(env.snapshot()))
        twin = copy.deepcopy(env)
        other: Any = make(pixels={**_PIXELS, "camera": (0, -1)})
        other.restore(snapshot)
        for action in actions:
            seen = env.step(action)
            assert seen.observation["pixels"].shape[-1] == 18
            _assert_same(seen, twin.step(action))
            _assert_same(seen, other.step(action))
        with pytest.raises(ValueError, match="the snapshot is of pixels"):
            make(pixels={**_PIXELS, "camera": [-1, 0]}).restore(snapshot)
        pixels = {**_PIXELS, "camera": [0, -1]}


@_draws
def test_pictures_of_a_list_of_cameras_are_joined_along_the_width() -> None:
    batch = _batch(pixels=None)
    batch.reset()
    size: dict[str, Any] = {"height": 12, "width": 16}
    kinds: list[dict[str, Any]] = [{}, {"depth": True}, {"segmentation": True}]
    for kwargs in kinds:
        one = [batch.render(camera=camera, **size, **kwargs) for camera in (0, -1)]
        both = batch.render(camera=[0, -1], **size, **kwargs)
        assert both.shape[:3] == (3, 12, 32)
        np.testing.assert_array_equal(both, np.concatenate(one, axis=2))
    assert batch.render([], camera_id=(0, -1), **size).shape == (0, 12, 32, 3)
    rows = RowsEnvironment(_single(pixels=None), 3, 1, seed=0)
    rows.reset()
    np.testing.assert_array_equal(
        rows.render(camera=[0, -1], **size), batch.render(camera=[0, -1], **size)
    )
    assert rows.render([], camera_id=(0, -1), **size).shape == (0, 12, 32, 3)
    with pytest.raises(ValueError, match="'fixt' does not exist"):
        batch.render(camera=[0, "fixt"], **size)


def test_every_picture_of_several_cameras_gets_the_overlays() -> None:
    seen = []

    def draw(**kwargs: Any) -> np.ndarray:
        seen.append((kwargs["camera_id"], list(kwargs["overlays"])))
        return np.full((1, 2), kwargs["camera_id"])

    overlays = (name for name in ("a", "b"))
    picture = render_cameras(draw, {"camera_id": [3, 4], "overlays": overlays}, axis=1)
    assert seen == [(3, ["a", "b"]), (4, ["a", "b"])]
    assert picture.tolist() == [[3, 3, 4, 4]]


# Partial resets, snapshots, copies.


@_draws
def test_a_reset_of_some_rows_leaves_the_pixels_of_others_alone() -> None:
    batch, twin = _batch(3), _batch(3)
    actions = _actions(batch, 3)
    for each in (batch, twin):
        each.reset()
        each.step(actions[0])
    before, _ = batch.step(actions[1]), twin.step(actions[1])
    after = batch.reset([1]).observation["pixels"]
    np.testing.assert_array_equal(after[[0, 2]], before.observation["pixels"][[0, 2]])
    first, second, third = _pictures(after[1])
    np.testing.assert_array_equal(first, third)
    np.testing.assert_array_equal(second, third)
    assert (third != _pictures(before.observation["pixels"][1])[2]).any()
    one, other = batch.step(actions[2]).observation, twin.step(actions[2]).observation
    np.testing.assert_array_equal(one["pixels"][[0, 2]], other["pixels"][[0, 2]])
    np.testing.assert_array_equal(one["pixels"][1, ..., :3], first)


@_draws
def test_rows_that_no_episode_was_begun_in_are_shown_as_they_are() -> None:
    batch = _batch(2)
    seen = batch.reset([1]).observation["pixels"]
    np.testing.assert_array_equal(
        _pictures(seen[0]), list(batch.render([0], height=12, width=16, camera=0)) * 3
    )


@_draws
@pytest.mark.parametrize("steps_before", [0, 2, _STEPS])
def test_a_snapshot_holds_the_stack(steps_before: int) -> None:
    for make in (_single, _batch):
        env: Any = make()
        env.reset()
        actions = _actions(env, steps_before + _STEPS + 2)
        for action in actions[:steps_before]:
            env.step(action)
        snapshot = pickle.loads(pickle.dumps(env.snapshot()))
        future = [env.step(action) for action in actions[steps_before:]]
        other: Any = make()
        other.reset()
        other.step(actions[0])
        for twin in (env, other):
            twin.restore(snapshot)
            for action, expected in zip(actions[steps_before:], future, strict=True):
                _assert_same(twin.step(action), expected)


@pytest.mark.parametrize("make", [_single, _batch])
@_draws
def test_a_snapshot_does_not_change_with_later_pixels(make: Any) -> None:
    env = make()
    env.reset()
    snapshot = env.snapshot()
    kept = {name: value.copy() for name, value in snapshot.frames.items()}
    for action in _actions(env, 2):
        env.step(action)
    for name, value in snapshot.frames.items():
        np.testing.assert_array_equal(value, kept[name], name)


@_draws
def test_a_row_goes_into_another_and_into_a_single_environment_with_its_stack() -> None:
    batch, single = _batch(3, _BALL), _single(9, _BALL)
    batch.reset()
    single.reset()
    for action in _actions(batch, 2):
        batch.step(action)
    batch.copy_row(0, 2)
    single.restore(batch.snapshot([0]))
    for action in _actions(batch, _STEPS + 3):
        action[2] = action[0]
        seen = batch.step(action).observation["pixels"]
        np.testing.assert_array_equal(seen[2], seen[0])
        np.testing.assert_array_equal(single.step(action[0]).observation["pixels"], seen[0])


@_draws
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("make", [_single, _batch])
@pytest.mark.parametrize("steps_before", [None, 0, 2])
def test_a_copy_observes_the_same_pixels(make: Any, copied: Any, steps_before: int | None) -> None:
    env = make()
    actions = _actions(env, _STEPS + 3)
    if steps_before is not None:
        env.reset()
        for action in actions[:steps_before]:
            env.step(action)
    twin = copied(env)
    for action in actions:
        _assert_same(env.step(action), twin.step(action))


@_draws
def test_a_snapshot_restores_into_an_environment_with_the_same_pixels_or_none() -> None:
    seeing, blind = _batch(), _batch(pixels=None)
    seeing.reset()
    blind.restore(seeing.snapshot())
    action = _actions(blind, 1)[0]
    one, other = blind.step(action).observation, seeing.step(action).observation
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name], name)
    seeing.restore(_restored_into_only(seeing).snapshot())
    for env in (seeing, _batch(pixels={**_PIXELS, "height": 13})):
        with pytest.raises(ValueError, match=r"the snapshot is of pixels .*; expected {'camera'"):
            env.restore(blind.snapshot())
    with pytest.raises(ValueError, match=r"'frame_stack': 3.*; expected .*'frame_stack': 2"):
        _batch(pixels={**_PIXELS, "frame_stack": 2}).restore(seeing.snapshot())


def _restored_into_only(batch: BatchEnvironment) -> BatchEnvironment:
    """A batch that observes the same pixels and nothing else."""
    only = _batch(pixels={**_PIXELS, "only": True})
    only.restore(batch.snapshot())
    return only


# Errors.


@pytest.mark.parametrize(
    ("pixels", "error", "message"),
    [
        ({"heigth": 84}, TypeError, r"no option 'heigth'\. Did you mean 'height'\? It takes: cam"),
        ({"camera_id": 0}, TypeError, "Did you mean 'camera'"),
        ("side", TypeError, "pixels is 'side'; expected a mapping"),
        ({"camera": "fixt"}, ValueError, "'fixt' does not exist"),
        ({"camera": 3}, ValueError, "camera_id is 3"),
        ({"camera": []}, ValueError, r"pixels' camera is \[\]; expected at least one camera"),
        ({"camera": [0, "fixt"]}, ValueError, "'fixt' does not exist"),
        ({"camera": [0, 3]}, ValueError, "camera_id is 3"),
        ({"camera": [[0]]}, TypeError, "expected the name or number of a camera, or a list of"),
        ({"camera": {0}}, TypeError, "expected the name or number of a camera, or a list of"),
        ({"width": 0}, ValueError, "image width is 0; expected a whole number"),
        ({"width": 10_000}, ValueError, "image width 10000 > "),
        ({"frame_stack": 0}, ValueError, "frame_stack is 0; expected a whole number of at least"),
        ({"frame_stack": 1.0}, ValueError, r"frame_stack is 1\.0; expected a whole number"),
        ({"quality": "fats"}, ValueError, r"quality is 'fats'.*Did you mean 'fast'"),
        ({"only": "yes"}, ValueError, "only is 'yes'; expected True or False"),
    ],
)
def test_bad_options_are_refused_when_the_environment_is_made(
    pixels: Any, error: Any, message: str
) -> None:
    for make in (_single, _batch):
        with pytest.raises(error, match=message):
            make(pixels=pixels)
    with pytest.raises(error, match=message):
        suite.load_batch(*_BALL, 2, environment_kwargs={"pixels": pixels})


def test_settings_are_arguments_of_a_picture() -> None:
    pixels = Pixels(camera="side", height=12, width=16, quality="fast", frame_stack=2)
    assert pixels.render_kwargs == {
        "camera_id": "side",
        "height": 12,
        "width": 16,
        "quality": "fast",
    }
    assert Pixels.of(pixels) is pixels
    assert Pixels.of({}) == Pixels(-1, 84, 84, only=False, frame_stack=1, quality="full")


def test_specs_and_settings_need_no_opengl() -> None:
    env, batch = _single(pixels={}), _batch(pixels={"frame_stack": 2})
    assert env.pixels == Pixels(camera=-1, height=84, width=84, only=False, frame_stack=1)
    assert env.observation_spec()["pixels"].shape == (84, 84, 3)
    assert batch.observation_spec()["pixels"].shape == (3, 84, 84, 6)
    assert _single(pixels=None).pixels is None
    assert _batch(pixels=None).pixels is None


class _Painter(base.Task):
    """Observes something under the name of the pictures."""

    def initialize_episode(self, physics: Any) -> None:
        pass

    def get_observation(self, physics: Any) -> collections.OrderedDict:
        return collections.OrderedDict(pixels=physics.position())

    def get_reward(self, physics: Any) -> float:
        return 0.0


def test_a_task_that_observes_pixels_of_its_own_is_refused() -> None:
    physics = _single(pixels=None).physics
    env = control.Environment(physics, _Painter(), pixels=_PIXELS)
    with pytest.raises(ValueError, match="the task observes one 'pixels'"):
        env.observation_spec()
    only = control.Environment(physics, _Painter(), pixels={**_PIXELS, "only": True})
    assert list(only.observation_spec()) == ["pixels"]


def test_a_physics_that_cannot_be_rendered_cannot_be_observed() -> None:
    with pytest.raises(TypeError, match="a str cannot be rendered; pixels need a limberjack"):
        Frames(Pixels(), "a picture")  # pyright: ignore[reportArgumentType]


@_draws
@pytest.mark.parametrize("is_reset", [False, True])
def test_after_an_interrupted_picture_the_rows_begin_an_episode(
    monkeypatch: pytest.MonkeyPatch, is_reset: bool
) -> None:
    batch = _batch(2)
    batch.reset()
    batch.step(np.zeros((2, 5)))

    def interrupt(*args: Any, **kwargs: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(type(batch.physics), "render", interrupt)
        with pytest.raises(KeyboardInterrupt):
            batch.reset([1]) if is_reset else batch.step(np.zeros((2, 5)))
    np.testing.assert_array_equal(batch.begins, [not is_reset, True])
    time_step = batch.step(np.zeros((2, 5)))
    begun = time_step.observation["pixels"][time_step.step_type == 0]
    assert len(begun) == 2 - is_reset
    np.testing.assert_array_equal(begun[..., :3], begun[..., 6:])
