"""The Stable-Baselines3 adapter is `DummyVecEnv` of single environments, only quicker."""

import contextlib
import logging
import os
import pickle
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest

from limberjack import gym, suite
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import scale
from tests.gym.gym_episodes import TASKS, assert_same, falling, falling_env, falling_envs

_REASON = "needs the extra 'sb3'"
torch: Any = pytest.importorskip("torch", reason=_REASON)
baselines: Any = pytest.importorskip("stable_baselines3", reason=_REASON)
env_checker: Any = pytest.importorskip("stable_baselines3.common.env_checker")
evaluation: Any = pytest.importorskip("stable_baselines3.common.evaluation")
monitor: Any = pytest.importorskip("stable_baselines3.common.monitor")
vec_env: Any = pytest.importorskip("stable_baselines3.common.vec_env")
sb3: Any = pytest.importorskip("limberjack.sb3")

_FLAT: dict[str, Any] = {"flat": True, "dtype": "float32"}
_NO_OPENGL = os.environ.get("MUJOCO_GL") == "disable"


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Small networks on a busy machine: with more threads PyTorch mostly waits for itself."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def _falling(num_envs: int = 3, **kwargs: Any) -> Any:
    return sb3.VecEnv(falling_envs(num_envs, autoreset_mode="SameStep", **_FLAT), **kwargs)


def _dummies(num_envs: int, domain: str, task: str, **kwargs: Any) -> Any:
    """SB3's own vector environment of single environments."""
    makers = [lambda: gym.load(domain, task, **_FLAT, **kwargs)] * num_envs
    return vec_env.DummyVecEnv(makers)


def _as_dummies_say(infos: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The infos in terms of the single environment's."""
    own = [{k: v for k, v in info.items() if k != "diverged"} for info in infos]
    return [
        {"success" if key == "is_success" else key: value for key, value in info.items()}
        for info in own
    ]


def _assert_lockstep(envs: Any, dummies: Any, steps: int) -> np.ndarray:
    """Fails unless both tell the same; returns how each row's episodes ended, by the limit or not.

    Reset infos are compared as well.
    """
    generator = np.random.default_rng(0)
    limits, ends = np.zeros(envs.num_envs, int), np.zeros(envs.num_envs, int)
    for seed in (5, None):
        if seed is not None:
            assert envs.seed(seed) == dummies.seed(seed)
        assert_same(envs.reset(), dummies.reset())
        assert_same(envs.reset_infos, dummies.reset_infos)
        for _ in range(steps):
            actions = generator.uniform(-1, 1, (envs.num_envs, *envs.action_space.shape))
            *got, infos = envs.step(actions.astype(np.float32))
            *expected, their_infos = dummies.step(actions.astype(np.float32))
            assert_same(got, expected)
            assert_same(_as_dummies_say(infos), their_infos)
            assert_same(envs.reset_infos, dummies.reset_infos)
            limits += [info["TimeLimit.truncated"] for info in infos]
            ends += got[2]
    return np.array([limits.sum(), (ends - limits).sum()])


# What SB3 demands.


@pytest.mark.parametrize(("domain", "task"), TASKS)
def test_the_single_environment_passes_sb3s_checker(domain: str, task: str) -> None:
    env = gymnasium.make(f"limberjack/{domain}-{task}-v0", flat=True)
    space = env.action_space
    assert isinstance(space, gymnasium.spaces.Box)
    with contextlib.ExitStack() as expected:
        # lqr has no bounds, and SB3 refuses it. escape and fetch of quadruped have others.
        if not np.isfinite(space.high).all():
            expected.enter_context(pytest.raises(AssertionError, match="finite lower and upper"))
        if (space.low != -1).any() or (space.high != 1).any():
            expected.enter_context(pytest.warns(UserWarning, match="symmetric and normalized"))
        env_checker.check_env(env)


@pytest.mark.parametrize(("domain", "task"), TASKS)
def test_a_batch_is_a_dummy_vec_env_bit_for_bit(domain: str, task: str) -> None:
    envs = sb3.make_vec_env(domain, task, 3, num_threads=2, time_limit=0.1)
    limits, others = _assert_lockstep(envs, _dummies(3, domain, task, time_limit=0.1), 12)
    assert limits
    assert not others


@pytest.mark.parametrize("sizes", [(5,), (3, 2)])
def test_ends_by_the_task_and_by_the_limit_are_those_of_a_dummy_vec_env(
    sizes: tuple[int, ...],
) -> None:
    envs = sb3.VecEnv(falling_envs(*sizes, autoreset_mode="SameStep", **_FLAT))
    dummies = vec_env.DummyVecEnv([lambda: falling_env(**_FLAT)] * 5)
    assert (_assert_lockstep(envs, dummies, 50) > 0).all()


def test_randomised_values_are_in_the_reset_infos() -> None:
    kwargs: Any = {"randomize": {"body_mass": scale(0.5, 2.0)}, "time_limit": 0.1}
    envs = sb3.make_vec_env("humanoid", "walk", 3, **kwargs)
    _assert_lockstep(envs, _dummies(3, "humanoid", "walk", **kwargs), 9)
    assert "body_mass" in envs.reset_infos[0]["randomization"]


def test_dict_observations_are_those_of_a_dummy_vec_env() -> None:
    envs = sb3.make_vec_env("humanoid", "walk", 2, flat=False, time_limit=0.1)
    makers = [lambda: gym.load("humanoid", "walk", dtype="float32", time_limit=0.1)] * 2
    envs.seed(1)
    dummies = vec_env.DummyVecEnv(makers)
    dummies.seed(1)
    assert_same(envs.reset(), dict(dummies.reset()))
    for _ in range(5):
        *got, infos = envs.step(np.zeros((2, 21)))
        observation, *expected, their_infos = dummies.step(np.zeros((2, 21), np.float32))
        assert_same(got, [dict(observation), *expected])
        assert_same(_as_dummies_say(infos), their_infos)


def test_arrays_are_float32_and_never_change_later() -> None:
    envs = _falling(seed=0)
    results: list[Any] = [(envs.reset(),)]
    copies = [results[0][0].copy()]
    for _ in range(20):
        results.append(envs.step(np.zeros((3, 21))))
        copies.append(results[-1][0].copy())
    assert all(np.array_equal(r[0], copy) for r, copy in zip(results, copies, strict=True))
    observation, reward, done, _ = results[-1]
    assert (observation.dtype, reward.dtype, done.dtype) == (np.float32, np.float32, bool)
    assert envs.observation_space.contains(observation[0])


def test_success_and_terms_are_reported_for_each_row() -> None:
    envs = sb3.make_vec_env("manipulator", "bring_ball", 2, seed=0)
    envs.reset()
    *_, infos = envs.step(np.zeros((2, 5)))
    assert [info["is_success"] for info in infos] == [False, False]
    assert infos[0]["reward_terms"].keys() == infos[1]["reward_terms"].keys() != set()


def test_a_row_that_diverges_ends_alone_with_a_finite_observation(
    caplog: pytest.LogCaptureFixture,
) -> None:
    envs = sb3.make_vec_env("humanoid", "walk", 3, seed=0)
    envs.reset()
    envs.vector_env.batches[0].physics.data.qpos[1, 2] = np.nan
    with caplog.at_level(logging.CRITICAL, "limberjack"):
        observation, rewards, dones, infos = envs.step(np.zeros((3, 21)))
    assert dones.tolist() == [info["diverged"] for info in infos] == [False, True, False]
    assert rewards[1] == 0
    assert not infos[1]["TimeLimit.truncated"]
    assert "reward_terms" not in infos[1]
    assert np.isfinite(observation).all()
    assert np.isfinite(infos[1]["terminal_observation"]).all()


# The rest of the interface.


def test_seeding_leaves_numpys_global_stream_alone() -> None:
    envs = _falling()
    before = repr(np.random.get_state())
    seeds = envs.seed()
    assert seeds == list(range(seeds[0], seeds[0] + 3))
    assert repr(np.random.get_state()) == before


def test_a_pickled_copy_continues_identically() -> None:
    envs = _falling(seed=0)
    envs.reset()
    envs.step(np.ones((3, 21)))
    copy = pickle.loads(pickle.dumps(envs))
    for _ in range(20):
        assert_same(envs.step(np.zeros((3, 21))), copy.step(np.zeros((3, 21))))


def test_a_seed_given_at_first_is_used_once() -> None:
    one, two = _falling(seed=7), _falling()
    two.seed(7)
    first = one.reset()
    np.testing.assert_array_equal(first, two.reset())
    assert not np.array_equal(one.reset(), first)


def test_options_of_rows_are_those_of_the_single_environments() -> None:
    envs, dummies = sb3.make_vec_env("humanoid", "walk", 3), _dummies(3, "humanoid", "walk")
    options = [{"state": {"qvel": np.full(27, 0.1)}}, {}, {"state": {"qvel": np.zeros(27)}}]
    for given in (options, options[0], None):
        for each in (envs, dummies):
            each.seed(4)
            each.set_options(given)
        assert_same(envs.reset(), dummies.reset())
        assert_same(envs.reset(), dummies.reset())  # options are used once
    for bad, message in (
        ({"stat": 1}, "Did you mean 'state'"),
        ([{}, {}, {"state": {"qps": 1}}], "state of row 2 has no field 'qps'"),
    ):
        envs.set_options(bad)
        with pytest.raises(TypeError, match=message):
            envs.reset()


def test_a_setting_of_the_task_is_set_in_all_rows_at_once() -> None:
    envs = sb3.make_vec_env("humanoid", "walk", 2, seed=0)
    assert envs.get_attr("_move_speed") == [1, 1]
    envs.set_attr("_move_speed", 10)
    assert envs.get_attr("_move_speed", 1) == [10]
    with pytest.raises(ValueError, match="'_move_speed' differs between rows"):
        envs.set_attr("_move_speed", 5, indices=0)
    run = sb3.make_vec_env("humanoid", "run", 2, seed=0)
    assert_same(envs.reset(), run.reset())
    actions = np.ones((2, 21), np.float32)
    assert_same(envs.step(actions)[:3], run.step(actions)[:3])


def test_attributes_are_those_of_a_row() -> None:
    envs = _falling()
    assert envs.get_attr("action_space") == [envs.action_space] * 3
    assert envs.get_attr("dt") == [0.025] * 3
    assert envs.get_attr("num_envs", 1) == [3]  # of the vector environment
    assert envs.get_attr("layout", 1) == [envs.vector_env.layout]
    assert not envs.has_attr("level")
    envs.set_attr("level", 4, indices=[0, 2])
    assert envs.get_attr("level", [0, 2]) == [4, 4]
    with pytest.raises(AttributeError, match="level"):
        envs.get_attr("level")
    with pytest.raises(AttributeError, match="all rows share the attribute 'render_mode'"):
        envs.set_attr("render_mode", "human")
    with pytest.raises(IndexError, match="row is 3; expected 0 to 2"):
        envs.get_attr("level", 3)


def test_methods_are_those_that_rows_have() -> None:
    envs = _falling()
    assert envs.env_method("render", indices=[0, 1]) == [None, None]
    assert envs.env_method("get_wrapper_attr", "render_mode") == [None] * 3
    assert envs.env_method("get_wrapper_attr", name="dt", indices=[1]) == [0.025]
    assert envs.env_method("control_timestep", indices=2) == [0.025]
    envs.set_attr("level", 4)
    assert envs.env_method("get_wrapper_attr", "level") == [4] * 3
    with pytest.raises(AttributeError, match=r"no method 'rendr'\. Did you mean 'render'"):
        envs.env_method("rendr")


def test_rows_are_not_wrapped() -> None:
    envs = _falling()
    assert envs.env_is_wrapped(monitor.Monitor) == [False] * 3
    assert envs.env_is_wrapped(gymnasium.Wrapper, indices=1) == [False]


@pytest.mark.skipif(_NO_OPENGL, reason="MUJOCO_GL turns rendering off")
def test_pictures_are_tiled() -> None:
    size = {"height": 24, "width": 32}
    envs = sb3.make_vec_env(
        "humanoid", "walk", 4, seed=0, render_mode="rgb_array", render_kwargs=size
    )
    envs.reset()
    picture = envs.render()
    assert picture.shape == (48, 64, 3)
    np.testing.assert_array_equal(picture[24:, 32:], envs.get_images()[3])
    assert envs.metadata["render_fps"] == 40
    envs.close()


def test_closing_twice_is_fine_and_using_it_later_is_not() -> None:
    envs = _falling()
    envs.reset()
    envs.close()
    envs.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="closed"):
        envs.reset()


# Refused.


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"autoreset_mode": "NextStep"}, "autoreset_mode is 'NextStep'; .* needs 'SameStep'"),
        ({"autoreset_mode": "SameStep", "copy": False, "flat": True}, "copy=True"),
    ],
)
def test_a_vector_environment_that_sb3_would_misread_is_refused(
    kwargs: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        sb3.VecEnv(falling_envs(2, **kwargs))


def test_anything_else_is_refused() -> None:
    single: Any = falling_env()
    with pytest.raises(TypeError, match="got Env; expected a limberjack"):
        sb3.VecEnv(single)


def test_refused_actions_change_nothing() -> None:
    envs, twin = _falling(seed=0), _falling(seed=0)
    for each in (envs, twin):
        each.reset()
    with pytest.raises(RuntimeError, match="there are no actions: call step_async"):
        envs.step_wait()
    for bad in (np.full((3, 21), np.nan), np.zeros((2, 21))):
        with pytest.raises(ValueError, match="actions"):
            envs.step(bad)
    assert_same(envs.step(np.ones((3, 21))), twin.step(np.ones((3, 21))))


@pytest.mark.parametrize("seed", [-1, 2**32 - 1])
def test_seeds_that_no_stream_takes_are_refused(seed: int) -> None:
    with pytest.raises(ValueError, match=r"expected (a whole number from 0|at most)"):
        _falling().seed(seed)


# Training.


def _parameters(model: Any) -> np.ndarray:
    return torch.cat([p.detach().flatten() for p in model.policy.parameters()]).numpy()


def _learn(make: Any, envs: Any, steps: int, **kwargs: Any) -> tuple[Any, np.ndarray]:
    """A model that has learned, and its parameters, which have changed and are finite."""
    model = make("MlpPolicy", envs, seed=3, device="cpu", **kwargs)
    before = _parameters(model)
    model.learn(steps)
    after = _parameters(model)
    assert model.num_timesteps >= steps
    assert np.isfinite(after).all()
    assert not np.array_equal(before, after)
    return model, after


def test_ppo_learns_what_it_learns_from_a_dummy_vec_env() -> None:
    kwargs: Any = {"n_steps": 128, "batch_size": 256, "n_epochs": 2}
    envs = sb3.make_vec_env("humanoid", "stand", 8, num_threads=2, time_limit=0.5)
    dummies = _dummies(8, "humanoid", "stand", time_limit=0.5)
    learned = []
    for each in (envs, dummies):
        wrapped = vec_env.VecNormalize(vec_env.VecMonitor(each))
        model, parameters = _learn(baselines.PPO, wrapped, 4000, **kwargs)
        learned.append(parameters)
        assert {episode["l"] for episode in model.ep_info_buffer} == {20}
        wrapped.training = False
        mean, _ = evaluation.evaluate_policy(model, wrapped, n_eval_episodes=8)
        assert mean > 0
    np.testing.assert_array_equal(*learned)


def test_sac_learns_what_it_learns_from_a_dummy_vec_env() -> None:
    kwargs: Any = {"learning_starts": 200, "policy_kwargs": {"net_arch": [64, 64]}}
    envs = sb3.make_vec_env("manipulator", "bring_ball", 8, num_threads=2, time_limit=0.5)
    dummies = _dummies(8, "manipulator", "bring_ball", time_limit=0.5)
    learned = []
    for each in (envs, dummies):
        model, parameters = _learn(baselines.SAC, each, 3000, **kwargs)
        learned.append(parameters)
        ends = model.replay_buffer.dones[:375].astype(bool)
        assert ends.sum() == 8 * (375 // 50)
        # A time limit is no end: the value of what would have followed counts.
        np.testing.assert_array_equal(model.replay_buffer.timeouts[:375].astype(bool), ends)
    np.testing.assert_array_equal(*learned)


def test_a_batch_of_ones_own_task_trains_as_well() -> None:
    batch = BatchEnvironment.from_environment(falling(), 4, 2)
    envs = vec_env.VecMonitor(sb3.VecEnv(batch, seed=0))
    model, _ = _learn(baselines.PPO, envs, 512, n_steps=64, batch_size=64, n_epochs=1)
    lengths = [episode["l"] for episode in model.ep_info_buffer]
    assert min(lengths) < max(lengths) == 16


def test_all_tasks_have_spaces_that_sb3_takes() -> None:
    for domain, task in suite.ALL_TASKS:
        envs = sb3.make_vec_env(domain, task, 1)
        baselines.PPO("MlpPolicy", envs, n_steps=2, batch_size=2, device="cpu")
        baselines.SAC("MlpPolicy", envs, buffer_size=10, device="cpu")


@pytest.mark.parametrize("task", [("lqr", "lqr_2_1"), ("humanoid", "walk")])
def test_actions_without_limits_are_offered_between_minus_1_and_1(task: tuple[str, str]) -> None:
    envs = sb3.make_vec_env(*task, 1)
    assert (envs.action_space.low == -1).all()
    assert (envs.action_space.high == 1).all()
    assert envs.action_space.dtype == envs.vector_env.single_action_space.dtype


@pytest.mark.parametrize(("domain", "bound"), [("lqr", 4), ("walker", 1)])
def test_another_bound_is_for_actions_without_limits_only(domain: str, bound: float) -> None:
    task = {"lqr": "lqr_2_1", "walker": "walk"}[domain]
    envs = gym.load_vector(domain, task, 1, **_FLAT, autoreset_mode="SameStep")
    space = sb3.VecEnv(envs, action_bound=4.0).action_space
    assert (space.low == -bound).all()
    assert (space.high == bound).all()


def test_several_tasks_are_one_vec_env_with_the_terms_of_each() -> None:
    tasks = ["pendulum:swingup", "reacher:easy"]
    envs = sb3.make_vec_env(tasks, num_envs=4, seed=3, time_limit=0.1)
    assert envs.observation_space.shape == (6,)
    assert envs.get_attr("task_ids")[0].tolist() == [0, 0, 1, 1]
    seen = envs.reset()
    alone = sb3.make_vec_env("reacher", "easy", 2, seed=5, time_limit=0.1)
    np.testing.assert_array_equal(seen[2:], alone.reset())
    actions = np.random.RandomState(0).uniform(-1, 1, (6, 4, 2)).astype(np.float32)
    for given in actions:
        seen, rewards, dones, infos = envs.step(given)
        its, own_rewards, own_dones, own_infos = alone.step(given[2:])
        np.testing.assert_array_equal(seen[2:], its)
        np.testing.assert_array_equal(rewards[2:], own_rewards)
        np.testing.assert_array_equal(dones[2:], own_dones)
        for info, own in zip(infos[2:], own_infos, strict=True):
            last, own_last = (one.pop("terminal_observation", None) for one in (info, own))
            np.testing.assert_array_equal(last, own_last)
            assert info == own
    with pytest.raises(ValueError, match="num_envs is 3; expected a multiple of 2"):
        sb3.make_vec_env(tasks, num_envs=3)
