"""`Env` of wrappers, subclasses and other environments, made directly, by name or by id."""

import copy
import functools
import os
import pickle
import sys
import types
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import error
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from limberjack import gym, rl, suite
from limberjack.rl import control
from limberjack.rl.randomize import scale
from limberjack.suite.wrappers import action_noise, action_scale
from limberjack.utils.containers import TaggedTasks
from tests.rl import odd_environments as odd

from .gym_episodes import assert_same

_NO_OPENGL = os.environ.get("MUJOCO_GL") == "disable"
_CHEETAH = ("cheetah", "run")


def _scaled(seed: int | None = None, **kwargs: Any) -> Any:
    env = suite.load(*_CHEETAH, {"random": seed, **kwargs})
    return action_scale.Wrapper(env, minimum=0.0, maximum=1.0)


def _noisy(seed: int) -> Any:
    return action_noise.Wrapper(suite.load(*_CHEETAH, {"random": seed}), scale=0.1)


def _nested(seed: int) -> Any:
    return action_noise.Wrapper(_scaled(seed), scale=0.1)


_WRAPPED = {"scaled": _scaled, "noisy": _noisy, "nested": _nested}


class _Domain(types.ModuleType):
    """A module of tasks whose factories return wrappers and subclasses."""

    SUITE = TaggedTasks()


@_Domain.SUITE.add()
def wrapped(time_limit: float = 0.2, random: Any = None, environment_kwargs: Any = None) -> Any:
    kwargs = {"random": random, "time_limit": time_limit}
    env = suite.load(*_CHEETAH, kwargs, environment_kwargs)
    return action_noise.Wrapper(env, scale=0.1)


@_Domain.SUITE.add()
def logged(time_limit: float = 0.12, random: Any = None, environment_kwargs: Any = None) -> Any:
    kwargs = {"time_limit": time_limit, **(environment_kwargs or {})}
    return odd.environment(odd.LastAction, random, odd.Logging, **kwargs)


@_Domain.SUITE.add()
def repeated(time_limit: float = 0.16, random: Any = None, environment_kwargs: Any = None) -> Any:
    return odd.Repeating(odd.environment(odd.LastAction, random, time_limit=time_limit))


@_Domain.SUITE.add()
def line(time_limit: float = 1, random: Any = None, environment_kwargs: Any = None) -> Any:
    return odd.Catch(0 if random is None else random)


@pytest.fixture
def domain() -> Iterator[str]:
    """The name of that domain, until the test ends."""
    name = "odd_of_these_tests"
    sys.modules[name] = _Domain(name)
    suite.register(name, sys.modules[name])
    yield name
    suite.unregister(name)
    del sys.modules[name]


@pytest.mark.parametrize("make", _WRAPPED.values(), ids=_WRAPPED)
@pytest.mark.parametrize("kwargs", [{}, {"flat": True, "dtype": "float32"}], ids=["dict", "flat"])
@pytest.mark.parametrize("is_instance", [False, True])
def test_gymnasiums_checker_finds_nothing_wrong(
    make: Any, kwargs: dict[str, Any], is_instance: bool
) -> None:
    env = gym.Env(make(0) if is_instance else make, **kwargs)
    check_env(env, skip_render_check=True)  # warnings are errors
    env.close()


@pytest.mark.parametrize("kind", odd.KINDS)
@pytest.mark.parametrize("flat", [False, True])
def test_every_kind_equals_its_row_in_a_vector_environment(kind: str, flat: bool) -> None:
    make = odd.KINDS[kind]
    batch = rl.batch_of(make, 1, 1, seed=0, vectorised=False)
    envs = gym.VectorEnv(batch, autoreset_mode="Disabled", flat=flat)
    env = gym.Env(make, flat=flat)
    assert env.observation_space == envs.single_observation_space
    assert env.action_space == envs.single_action_space
    for seed in (3, None, 8, 3):
        seen, _ = env.reset(seed=seed)
        rows, _ = envs.reset(seed=seed)
        assert_same(seen, _first(rows))
        for action in odd.actions_of(9, 1):
            one, row = env.step(action[0]), envs.step(action)
            assert_same(one[0], _first(row[0]))
            assert one[1:4] == tuple(values[0] for values in row[1:4])
            if one[2] or one[3]:
                break
    envs.close()


def _first(observation: Any) -> Any:
    if isinstance(observation, dict):
        return {name: value[0] for name, value in observation.items()}
    return observation[0]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("make", _WRAPPED.values(), ids=_WRAPPED)
def test_a_copy_continues_as_the_original_does(make: Any, copied: Any) -> None:
    env = gym.Env(make)
    env.reset(seed=0)
    env.step(np.ones(6))
    twin = copied(env)
    for each in (env, twin):
        each.action_space.seed(0)
    for _ in range(3):
        assert_same(env.step(np.ones(6)), twin.step(np.ones(6)))
    assert_same(env.reset(), twin.reset())
    assert_same(env.reset(seed=3), twin.reset(seed=3))


def test_actions_are_repeated_for_a_wrapper_as_in_its_row() -> None:
    env = gym.Env(_noisy, action_repeat=3)
    envs = gym.VectorEnv(rl.batch_of(_noisy, 1, 1, seed=0, vectorised=False, action_repeat=3))
    assert env.dt == envs.dt == pytest.approx(0.03)
    env.reset(seed=2)
    envs.reset(seed=2)
    action = np.full(6, 0.5)
    for _ in range(4):
        one, row = env.step(action), envs.step(action[None])
        assert one[1] == row[1][0]
        assert one[4]["reward_terms"] == {
            name: value[0] for name, value in row[4]["reward_terms"].items() if name[0] != "_"
        }
    envs.close()


def test_attributes_of_the_environment_and_its_task_are_set_for_later_seeds() -> None:
    env: Any = gymnasium.wrappers.OrderEnforcing(gym.Env(_noisy))
    assert env.get_wrapper_attr("dt") == pytest.approx(0.01)
    assert not env.has_wrapper_attr("nonsense")
    with pytest.raises(AttributeError, match="nonsense"):
        env.get_wrapper_attr("nonsense")
    assert env.set_wrapper_attr("_noise_std", np.zeros(6), force=False)
    assert not env.set_wrapper_attr("nonsense", 1, force=False)
    plain = gym.load(*_CHEETAH)
    for seed in (1, 2):
        env.reset(seed=seed)
        plain.reset(seed=seed)
        assert env.step(np.full(6, 0.3))[1] == plain.step(np.full(6, 0.3))[1]
    assert env.get_wrapper_attr("_noise_std").tolist() == [0] * 6
    assert env.get_wrapper_attr("control_timestep")() == 0.01


def test_gymnasiums_vector_environment_reaches_settings_of_the_task() -> None:
    sync = SyncVectorEnv([functools.partial(gym.load, "humanoid", "walk")] * 2)
    envs = gym.load_vector("humanoid", "walk", 2, num_threads=1)
    for each in (sync, envs):
        each.set_attr("_move_speed", 5.0)
        assert each.get_attr("_move_speed") == (5.0, 5.0)
        each.reset(seed=0)
    actions = np.ones((2, 21), np.float32)
    assert_same(sync.step(actions)[1], envs.step(actions)[1])
    sync.close()
    envs.close()


# Snapshots and states.


@pytest.mark.parametrize("make", _WRAPPED.values(), ids=_WRAPPED)
def test_a_reset_continues_from_a_snapshot(make: Any) -> None:
    env = gym.Env(make)
    env.reset(seed=0)
    env.step(np.ones(6))
    snapshot = env.snapshot()
    expected = [env.step(np.ones(6)) for _ in range(2)]
    other = gym.Env(make)
    other.restore(snapshot)
    assert_same([other.step(np.ones(6)) for _ in range(2)], expected)
    for each in (env, other):
        each.reset(seed=1, options={"state": snapshot})
        assert_same([each.step(np.ones(6)) for _ in range(2)], expected)


def test_rows_of_a_vector_environment_continue_from_snapshots_of_wrappers() -> None:
    env = gym.Env(_noisy)
    envs = gym.VectorEnv(rl.batch_of(_noisy, 2, 1, seed=0, vectorised=False))
    env.reset(seed=0)
    env.step(np.ones(6))
    snapshot = env.snapshot()
    expected = [env.step(np.ones(6))[1] for _ in range(2)]
    envs.reset(seed=5, options={"state": [None, snapshot]})
    assert [envs.step(np.ones((2, 6)))[1][1] for _ in range(2)] == expected
    both = envs.batches[0].snapshot()
    after = envs.step(np.ones((2, 6)))[1]
    envs.reset(options={"state": both})
    assert_same(envs.step(np.ones((2, 6)))[1], after)
    envs.close()


def test_a_state_that_an_environment_cannot_take_is_refused_and_nothing_is_reset() -> None:
    env, twin = gym.Env(_noisy), gym.Env(_noisy)
    for each in (env, twin):
        each.reset(seed=0)
    plain = gym.load(*_CHEETAH)
    plain.reset(seed=0)
    for state, kind, message in (
        ({"qvel": np.zeros(9)}, TypeError, "a Wrapper cannot begin in a given state; expected a"),
        (plain.snapshot(), ValueError, "expected copies of environments"),
    ):
        with pytest.raises(kind, match=message):
            env.reset(seed=1, options={"state": state})
    assert_same(env.step(np.ones(6)), twin.step(np.ones(6)))


def test_a_subclass_begins_in_a_given_state() -> None:
    env = gym.Env(functools.partial(odd.of_class, odd.Logging))
    seen, _ = env.reset(seed=0, options={"state": {"qpos": [0.25]}})
    assert seen["position"].tolist() == [0.25]


# What an environment lacks.


def test_a_seed_that_an_environment_cannot_take_is_refused_and_nothing_is_reset() -> None:
    env, twin = gym.Env(odd.distracting(0)), gym.Env(odd.distracting(0))
    for each in (env, twin):
        each.reset()
    with pytest.raises(TypeError, match=r"_random_state .* pass a function build\(seed\)"):
        env.reset(seed=1)
    assert_same(env.step([0.5]), twin.step([0.5]))
    gym.Env(odd.distracting).reset(seed=1)


def test_an_environment_without_physics_plays_but_is_not_drawn() -> None:
    env = gym.Env(odd.Catch)
    env.reset(seed=0)
    assert not hasattr(env, "physics")
    assert np.isnan(env.dt)
    assert "render_fps" not in env.metadata
    assert env.render() is None
    with pytest.raises(TypeError, match="a Catch has no physics to draw; expected None"):
        gym.Env(odd.Catch, render_mode="rgb_array")
    check_env(env, skip_render_check=True)


def test_other_things_are_refused() -> None:
    other: Any = "humanoid:walk"
    with pytest.raises(TypeError, match=r"expected a dm_env\.Environment or a function build"):
        gym.Env(other)


def test_a_closed_or_ended_environment_is_not_stepped() -> None:
    env = gym.Env(functools.partial(_scaled, time_limit=0.02))
    with pytest.raises(error.ResetNeeded):
        env.step(np.zeros(6))
    env.reset(seed=0)
    assert not env.step(np.zeros(6))[3]
    assert env.step(np.zeros(6))[3]
    with pytest.raises(error.ResetNeeded):
        env.step(np.zeros(6))
    assert repr(env) == "<Env cheetah:run, seed 0, step 2 of 2>"
    env.close()
    env.close()
    with pytest.raises(error.ClosedEnvironmentError):
        env.snapshot()


@pytest.mark.skipif(_NO_OPENGL, reason="MUJOCO_GL turns rendering off")
def test_a_wrapper_is_drawn_as_its_physics() -> None:
    env = gym.Env(_scaled, render_mode="rgb_array", width=32, height=24, camera_id=0)
    plain = gym.load(*_CHEETAH, render_mode="rgb_array", width=32, height=24, camera_id=0)
    for each in (env, plain):
        each.reset(seed=2)
    np.testing.assert_array_equal(env.render(), plain.render())  # pyright: ignore
    assert env.metadata["render_fps"] == 100


# By name.


@pytest.mark.parametrize("task", ["wrapped", "logged", "repeated", "line"])
def test_what_a_registered_factory_returns_is_loaded_by_name_and_by_id(
    domain: str, task: str
) -> None:
    env = gym.load(domain, task)
    made: Any = gymnasium.make(f"limberjack/{domain}-{task}-v0")
    envs = gym.load_vector(domain, task, 1, num_threads=1, autoreset_mode="Disabled")
    for seed in (4, None, 4):
        starts = [each.reset(seed=seed)[0] for each in (env, made)]
        assert_same(starts[0], starts[1])
        assert_same(starts[0], _first(envs.reset(seed=seed)[0]))
        steps: list[Any] = []
        for number in range(60):
            action = env.action_space.sample()
            steps = [each.step(action) for each in (env, made)]
            assert_same(steps[0], steps[1])
            row = envs.step(action[None])
            assert steps[0][1:4] == tuple(values[0] for values in row[1:4]), number
            if steps[0][2] or steps[0][3]:
                break
        assert steps[0][2] or steps[0][3]
    check_env(made.unwrapped, skip_render_check=True)
    envs.close()


def test_arguments_of_load_reach_every_seed_of_a_wrapper(domain: str) -> None:
    env = gym.load(
        domain, "wrapped", time_limit=0.05, randomize={"body_mass": scale(0.5, 2)}, action_repeat=2
    )
    for seed in (0, 7):
        _, info = env.reset(seed=seed)
        drawn = info["randomization"]["body_mass"]
        np.testing.assert_array_equal(env.physics.model.body_mass, drawn)
        ends = [env.step(np.zeros(6))[3] for _ in range(3)]
        assert ends == [False, False, True]
    first = gym.load(domain, "wrapped", task_kwargs={"random": 3}).reset()[0]
    assert_same(first, gym.load(domain, "wrapped").reset(seed=3)[0])


@pytest.mark.parametrize("task", ["wrapped", "repeated"])
@pytest.mark.parametrize("most", [3, 40])
def test_gymnasiums_number_of_steps_counts_actions_of_a_wrapper(
    domain: str, task: str, most: int
) -> None:
    env: Any = gymnasium.make(f"limberjack/{domain}-{task}-v0", max_episode_steps=most)
    for seed in (0, 1):
        env.reset(seed=seed)
        ends = [env.step(np.zeros(env.action_space.shape))[3] for _ in range(most)]
        assert ends == [False] * (most - 1) + [True]
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape))
    snapshot = env.unwrapped.snapshot()
    gym.restore(env, snapshot)
    env.step(np.zeros(env.action_space.shape))


def test_a_plain_task_of_a_registered_domain_is_seeded_in_place(domain: str) -> None:
    env = gym.Env(functools.partial(odd.of_task, odd.Counting))
    kept = env.environment
    for seed in (0, 5, 0):
        env.reset(seed=seed)
        assert env.step([0.0])[1] == pytest.approx(np.cos(env.physics.data.qpos[0]) + 1)
        assert env.environment is kept
    assert isinstance(kept, control.Environment)
