"""Pixel observations in Gymnasium's terms: spaces, and rows that see what `Env` sees."""

import copy
import os
import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import vector as wrappers

from limberjack import gym, rl, suite
from limberjack.rl.batch import BatchEnvironment
from limberjack.suite.wrappers import pixels
from tests.plain_pictures import draw_plainly

from .gym_episodes import MODES, assert_same, told_alike

_draws = pytest.mark.skipif(
    os.environ.get("MUJOCO_GL") == "disable", reason="MUJOCO_GL turns rendering off"
)
_PIXELS: dict[str, Any] = {"camera": "fixed", "height": 12, "width": 16, "frame_stack": 2}
_BALL = ("manipulator", "bring_ball")
_STEPS = 4  # in an episode
_FORMS = pytest.mark.parametrize(
    ("only", "flat"), [(False, False), (False, True), (True, True)], ids=["dict", "flat", "only"]
)


# Both sizes in two modes each, where there are three modes.
_MODES_AND_SIZES = [
    (AutoresetMode.NEXT_STEP, (3,)),
    (AutoresetMode.SAME_STEP, (2, 1)),
    (AutoresetMode.DISABLED, (3,)),
    (AutoresetMode.DISABLED, (2, 1)),
]


def _load(only: bool = False, **kwargs: Any) -> gym.Env:
    pixels = {**_PIXELS, "only": only}
    return gym.load(*_BALL, time_limit=_STEPS * 0.01, pixels=pixels, **kwargs)


def _single(only: bool, frame_stack: int) -> Any:
    pixels = {**_PIXELS, "only": only, "frame_stack": frame_stack}
    env = suite.load(*_BALL, {"time_limit": _STEPS * 0.01}, {"pixels": pixels})
    draw_plainly(env.physics.model)
    return env


def _env(only: bool = False, frame_stack: int = 2, **kwargs: Any) -> gym.Env:
    return gym.Env(_single(only, frame_stack), **kwargs)


def _envs(*sizes: int, only: bool = False, frame_stack: int = 2, **kwargs: Any) -> gym.VectorEnv:
    single = _single(only, frame_stack)
    batches = [BatchEnvironment.from_environment(single, size, 2) for size in sizes]
    return gym.VectorEnv(*batches, **kwargs)


def _pixels(observation: Any) -> np.ndarray:
    return observation["pixels"] if isinstance(observation, dict) else observation


# Spaces.


@_draws
def test_gymnasiums_checker_finds_nothing_wrong() -> None:
    for only, flat in ((False, False), (True, False)):
        check_env(_env(only, flat=flat), skip_render_check=True)  # warnings are errors


def test_spaces_have_the_pictures_beside_the_state_or_alone() -> None:
    picture = gymnasium.spaces.Box(0, 255, (12, 16, 6), np.uint8)
    plain: Any = gym.load(*_BALL).observation_space
    space: Any = _load().observation_space
    assert list(space.spaces) == [*plain.spaces, "pixels"]
    assert space["pixels"] == picture
    assert all(space[name] == plain[name] for name in plain)
    kwargs: Any = {"flat": True, "dtype": "float32"}
    flat, plain_flat = _load(**kwargs), gym.load(*_BALL, **kwargs)
    space = flat.observation_space
    assert list(space.spaces) == ["state", "pixels"]
    assert space["pixels"] == picture
    assert space["state"] == plain_flat.observation_space
    assert flat.layout == plain_flat.layout
    only = _load(only=True, flat=True)
    assert only.observation_space == picture
    assert only.layout == ()


@_draws
@_FORMS
def test_observations_lie_in_the_spaces(only: bool, flat: bool) -> None:
    kwargs: Any = {"only": only, "flat": flat, "dtype": "float32"}
    each: Any = (_env(**kwargs), _envs(2, **kwargs), _envs(1, 1, **kwargs))
    for env in each:
        observation, _ = env.reset(seed=0)
        assert env.observation_space.contains(observation)
        observation, *_ = env.step(np.zeros(env.action_space.shape))
        assert env.observation_space.contains(observation)


@_draws
def test_an_id_takes_pixels() -> None:
    name = "limberjack/manipulator-bring_ball-v0"
    env = gymnasium.make(name, pixels=_PIXELS)
    envs = gymnasium.make_vec(
        name, num_envs=2, vectorization_mode="vector_entry_point", pixels=_PIXELS, num_threads=2
    )
    one, _ = env.reset(seed=5)
    rows, _ = envs.reset(seed=4)
    np.testing.assert_array_equal(rows["pixels"][1], one["pixels"])


# Rows.


@_draws
@_FORMS
@pytest.mark.parametrize(
    ("mode", "sizes"),
    [pytest.param(*one, id=f"{one[0].value}-{len(one[1])}") for one in _MODES_AND_SIZES],
)
def test_rows_have_the_pictures_of_single_environments(
    sizes: tuple[int, ...], mode: AutoresetMode, only: bool, flat: bool
) -> None:
    kwargs: dict[str, Any] = {"only": only, "flat": flat}
    envs = wrappers.DictInfoToList(_envs(*sizes, autoreset_mode=mode, **kwargs))
    makers = [lambda: _env(**kwargs)] * 3
    reference = wrappers.DictInfoToList(SyncVectorEnv(makers, autoreset_mode=mode))

    def compare(one: Any, other: Any) -> None:
        (*values, infos), (*others, expected) = one, other
        assert_same(values, others)
        assert_same(told_alike(infos), expected)

    compare(envs.reset(seed=3), reference.reset(seed=3))
    actions = np.random.RandomState(0).uniform(-1, 1, (_STEPS + 3, 3, 5))
    for action in actions:
        result = envs.step(action)
        compare(result, reference.step(action))
        ended = result[2] | result[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            masks = [{"reset_mask": ended.copy()} for _ in range(2)]
            compare(envs.reset(options=masks[0]), reference.reset(options=masks[1]))


@_draws
@pytest.mark.parametrize("mode", MODES)
def test_a_masked_reset_begins_the_stacks_of_its_rows_only(mode: AutoresetMode) -> None:
    envs = _envs(3, autoreset_mode=mode, flat=True, copy=False)
    envs.reset(seed=0)
    envs.step(np.ones((3, 5)))
    before = envs.step(np.ones((3, 5)))[0]["pixels"]
    mask = np.array([False, True, False])
    after = envs.reset(options={"reset_mask": mask})[0]["pixels"]
    np.testing.assert_array_equal(after[~mask], before[~mask])
    np.testing.assert_array_equal(after[1, ..., :3], after[1, ..., 3:])
    assert (after[1] != before[1]).any()


@_draws
def test_final_observations_have_the_last_pictures() -> None:
    same, following = (_envs(2, autoreset_mode=mode) for mode in ("SameStep", "NextStep"))
    for envs in (same, following):
        envs.reset(seed=1)
        for _ in range(_STEPS - 1):
            envs.step(np.ones((2, 5)))
    step, expected = same.step(np.ones((2, 5))), following.step(np.ones((2, 5)))
    for row in range(2):
        final = step[-1]["final_obs"][row]["pixels"]
        np.testing.assert_array_equal(final, expected[0]["pixels"][row])
    begun = following.step(np.ones((2, 5)))[0]["pixels"]
    np.testing.assert_array_equal(step[0]["pixels"], begun)


@_draws
def test_halves_in_turn_have_the_pictures_of_a_batch() -> None:
    envs, batch = _envs(2, 1, only=True), _envs(3, only=True)
    envs.reset(seed=0)
    batch.reset(seed=[0, 1, 2])
    for half, rows in enumerate(envs.halves):
        envs.send(np.ones((rows.stop - rows.start, 5)), half)
    expected = batch.step(np.ones((3, 5)))[0]
    for rows in envs.halves:
        observation, *_, info = envs.recv()
        np.testing.assert_array_equal(observation, expected[rows])
        assert info["env_id"].tolist() == list(range(rows.start, rows.stop))


@_draws
@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("make", [_env, lambda: _envs(2), lambda: _envs(1, 1)])
def test_a_copy_observes_the_same_pixels(make: Any, copied: Any) -> None:
    env = make()
    env.reset(seed=0)
    action = np.ones(env.action_space.shape)
    env.step(action)
    twin = copied(env)
    for _ in range(2):
        assert_same(env.step(action)[0], twin.step(action)[0])


@_draws
def test_a_snapshot_of_a_row_holds_its_stack() -> None:
    envs = _envs(3, only=True)
    envs.reset(seed=0)
    envs.step(np.ones((3, 5)))
    envs.batches[0].copy_row(0, 2)
    observations = envs.step(np.ones((3, 5)))[0]
    np.testing.assert_array_equal(observations[2], observations[0])
    assert (observations[2] != observations[1]).any()


@_draws
@pytest.mark.parametrize("make", [_env, lambda **kwargs: _envs(1, **kwargs)])
def test_one_picture_needs_no_stack(make: Any) -> None:
    env = make(
        frame_stack=1,
        render_mode="rgb_array",
        render_kwargs={"camera": "fixed", "height": 12, "width": 16},
    )
    env.reset(seed=0)
    observation, *_ = env.step(np.ones(env.action_space.shape))
    drawn = np.asarray(env.render())
    np.testing.assert_array_equal(_pixels(observation), drawn)


# Refused input.


@pytest.mark.parametrize("only", [True, False])
def test_pictures_of_the_suites_wrapper_stay_pictures(only: bool) -> None:
    def build(seed: int) -> Any:
        env = suite.load("cartpole", "swingup", {"random": seed})
        size = {"height": 8, "width": 8, "camera_id": 0}
        return pixels.Wrapper(env, pixels_only=only, render_kwargs=size)

    one = gym.Env(build)
    rows = gym.VectorEnv(rl.batch_of(build, 2, seed=0))
    space = gymnasium.spaces.Box(0, 255, (8, 8, 3), np.uint8)
    for envs in (one.observation_space, rows.single_observation_space):
        assert (envs if only else envs["pixels"]) == space  # pyright: ignore[reportIndexIssue]
    for env in (one, rows):
        observation: Any = env.reset(seed=0)[0]
        picture = observation if only else observation["pixels"]
        assert picture.dtype == np.uint8
        assert env.observation_space.contains(observation)
    one.close()
    rows.close()


def _load_vector(domain: str, task: str, **kwargs: Any) -> gym.VectorEnv:
    return gym.load_vector(domain, task, 2, **kwargs)


@pytest.mark.parametrize("load", [gym.load, _load_vector])
def test_bad_options_are_refused_with_a_suggestion(load: Any) -> None:
    with pytest.raises(TypeError, match=r"no option 'frame_stak'\. Did you mean 'frame_stack'"):
        load(*_BALL, pixels={"frame_stak": 3})
    with pytest.raises(ValueError, match="Did you mean 'fixed'"):
        load(*_BALL, pixels={"camera": "fixd"})
    with pytest.raises(TypeError, match="pixels is given twice"):
        load(*_BALL, pixels=_PIXELS, environment_kwargs={"pixels": _PIXELS})
    with pytest.raises(TypeError, match="camera is given twice"):
        load(*_BALL, render_kwargs={"camera": 0, "camera_id": 0})
