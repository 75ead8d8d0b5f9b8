"""Transitions that the algorithm learns from, and the layers of its policy."""

import dataclasses
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from limberjack import gym
from limberjack.policies import mlp
from limberjack.training import TABLE, Settings
from limberjack.training.demonstrations import Demonstrations
from tests.gym.gym_episodes import falling_envs
from tests.training.small import SMALL

_REASON = "needs the extra 'train'"
pytest.importorskip("sbx", reason=_REASON)
learner: Any = pytest.importorskip("limberjack.training.learner")
sb3: Any = pytest.importorskip("limberjack.sb3")

_HOW: dict[str, Any] = {"autoreset_mode": "SameStep", "flat": True, "dtype": "float32"}


def _learned(envs: Any, folder: Path, settings: Settings = SMALL) -> Any:
    one = learner.Learner(sb3.VecEnv(envs), settings, 0, folder)
    one.learn(lambda: None)
    return one


def _averaged_actions(one: Any, observations: np.ndarray) -> np.ndarray:
    """The actions of the averaged policy, as the algorithm's own network computes them."""
    policy = one._model.policy
    present = policy.actor_state
    policy.actor_state = present.replace(**one._average)
    try:
        return one._model.predict(observations, deterministic=True)[0]
    finally:
        policy.actor_state = present


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    envs = gym.load_vector("pendulum", "swingup", 3, time_limit=0.4, action_repeat=2, **_HOW)
    yield _learned(envs, tmp_path_factory.mktemp("events"))
    envs.close()


def test_states_after_a_time_limit_count(pendulum: Any) -> None:
    kept = pendulum.state()["transitions"]
    assert kept["dones"].any()
    np.testing.assert_array_equal(kept["timeouts"], kept["dones"])
    drawn = pendulum._model.replay_buffer.sample(500)
    assert not drawn.dones.numpy().any()
    # What followed is the last observation of the episode, not the first one of the next.
    ended = kept["dones"].astype(bool)
    following = np.roll(kept["observations"], -1, axis=0)
    same = (kept["next_observations"] == following).all(axis=-1)
    place = kept["dones"].shape[0] - 1 if not pendulum._model.replay_buffer.full else None
    running = ~ended
    running[pendulum._model.replay_buffer.pos - 1 if place is None else place] = False
    assert same[running].all()
    assert not same[ended].any()


def test_rewards_are_learned_without_their_offset(tmp_path: Path) -> None:
    kept = []
    for offset in (0.0, 0.25):
        envs = gym.load_vector("cartpole", "balance", 3, time_limit=0.4, action_repeat=2, **_HOW)
        settings = dataclasses.replace(SMALL, steps=60, reward_offset=offset)  # all at random
        kept.append(_learned(envs, tmp_path, settings).state()["transitions"]["rewards"])
        envs.close()
    np.testing.assert_array_equal(kept[1], kept[0] - np.float32(0.5))


def test_rewards_of_several_actions_are_added_up_until_an_episode_ends(tmp_path: Path) -> None:
    envs = gym.load_vector("cartpole", "balance", 3, time_limit=0.1, action_repeat=2, **_HOW)
    settings = dataclasses.replace(SMALL, steps=60, n_steps=3, discount=0.9)  # all at random
    one = _learned(envs, tmp_path, settings)
    envs.close()
    kept, drawn = one.state()["transitions"], one._model.replay_buffer.sample(50)
    seen = set()
    for row, observation in enumerate(drawn.observations.numpy()):
        same = (kept["observations"] == observation).all(axis=-1)
        ((step, env),) = np.argwhere(same)
        rewards, ended = (kept[name][step : step + 3, env] for name in ("rewards", "dones"))
        count = int(np.argmax(ended)) + 1 if ended.any() else len(rewards)
        expected = sum(0.9**k * reward for k, reward in enumerate(rewards[:count]))
        assert drawn.rewards[row].item() == pytest.approx(expected, rel=1e-6)
        assert drawn.discounts[row].item() == pytest.approx(0.9**count, rel=1e-6)
        following = kept["next_observations"][step + count - 1, env]
        np.testing.assert_array_equal(drawn.next_observations[row].numpy(), following)
        seen.add(count)
    assert seen == {1, 2, 3}


def test_half_of_each_batch_is_demonstrations(tmp_path: Path) -> None:
    envs = gym.load_vector("cartpole", "balance", 3, time_limit=0.1, action_repeat=2, **_HOW)
    count, size = 40, 5
    shown = Demonstrations(
        observations=np.full((count, size), 9.0, "f4"),
        next_observations=np.full((count, size), 8.0, "f4"),
        actions=np.linspace(-3, 3, count, dtype="f4")[:, np.newaxis],
        rewards=np.full(count, 7.0, "f4"),
        is_last=np.arange(count) % 10 == 9,
        is_truncated=np.arange(count) == 9,
    )
    settings = dataclasses.replace(SMALL, steps=60, n_steps=1, reward_offset=0.5)  # all at random
    bounded = sb3.VecEnv(envs)
    bounded.action_space = gymnasium.spaces.Box(-4, 4, (1,))  # as of a task without bounds
    one = learner.Learner(bounded, settings, 0, tmp_path, shown)
    one.learn(lambda: None)
    envs.close()
    np.random.seed(0)
    drawn = one._model.replay_buffer.sample(2000)
    is_shown = (drawn.observations.numpy() == 9).all(axis=1)
    assert is_shown.sum() == 1000
    parts = is_shown.reshape(10, 200).sum(axis=1)  # what single updates learn from
    assert parts.min() > 70
    assert parts.max() < 130
    assert (drawn.next_observations.numpy()[is_shown] == 8).all()
    np.testing.assert_array_equal(drawn.rewards.numpy()[is_shown], 7 - 0.5 * 2)
    actions = np.unique(drawn.actions.numpy()[is_shown])  # as the policy's, between -1 and 1
    np.testing.assert_allclose(actions, np.linspace(-0.75, 0.75, count), atol=1e-6)  # float32
    ended = drawn.dones.numpy()[is_shown].mean()
    assert 0.04 < ended < 0.11  # three of forty: the fourth end is by the limit
    assert not (drawn.rewards.numpy()[~is_shown] == 6).any()


def test_noise_changes_slowly_has_its_size_and_begins_anew_with_an_episode() -> None:
    np.random.seed(0)
    noise = learner._Noise((500, 2))
    noise.std = 0.3
    drawn = np.array([noise() for _ in range(200)])
    late = drawn[50:]
    assert late.std() == pytest.approx(0.3, rel=0.02)
    for distance, expected in ((1, math.exp(-0.1)), (10, math.exp(-1))):
        found = np.corrcoef(late[:-distance].ravel(), late[distance:].ravel())[0, 1]
        assert found == pytest.approx(expected, abs=0.02)
    noise.reset(indices=[3])
    assert (noise.values[3] == 0).all()
    noise.reset()  # as learning goes on
    assert (noise.values[4] == drawn[-1, 4]).all()


def test_noise_is_added_to_actions(tmp_path: Path) -> None:
    taken = []
    for std in (0.0, 0.9):
        envs = gym.load_vector("pendulum", "swingup", 3, time_limit=4.0, action_repeat=2, **_HOW)
        settings = dataclasses.replace(SMALL, steps=600, noise=std)
        settings = dataclasses.replace(settings, random_steps=1000)  # no learning
        taken.append(_learned(envs, tmp_path, settings).state()["transitions"]["actions"])
        envs.close()
    without, noisy = taken
    changes = np.abs(noisy - without)
    first, last = changes[: len(changes) // 3], changes[-len(changes) // 3 :]
    assert 0.1 < first.mean() < 0.4
    assert last.mean() < 0.05  # it fell to 0, and the rest of it decays
    assert np.abs(noisy).max() <= 1


def test_states_after_a_fall_do_not_count(tmp_path: Path) -> None:
    envs = falling_envs(3, **_HOW)
    settings = dataclasses.replace(SMALL, action_repeat=1, steps=150, time_limit=None)
    kept = _learned(envs, tmp_path, settings).state()["transitions"]
    fell = kept["dones"].astype(bool) & ~kept["timeouts"].astype(bool)
    assert fell.any()
    envs.close()


def test_layers_act_as_the_learner_does(pendulum: Any, tmp_path: Path) -> None:
    card = mlp.Card((("observations", (3,)),), (-1.0,), (1.0,), "relu", "tanh", 2)
    mlp.save(tmp_path / "policy.safetensors", pendulum.layers(), card)
    policy = mlp.load(tmp_path / "policy.safetensors")
    observations = np.random.RandomState(0).normal(0, 3, (1000, 3)).astype(np.float32)
    expected = _averaged_actions(pendulum, observations)
    assert np.ptp(expected) > 0.01
    # Sums of float32 in another order, and folded layers; docs/training.md promises 1e-5.
    np.testing.assert_allclose(policy.actions(observations), expected, rtol=0, atol=1e-5)


def test_a_policy_without_hidden_layers_is_linear_within_its_bounds(tmp_path: Path) -> None:
    settings = dataclasses.replace(SMALL, actor=())
    envs = gym.load_vector("pendulum", "swingup", 3, time_limit=0.4, action_repeat=2, **_HOW)
    try:
        (layer,) = _learned(envs, tmp_path, settings).layers()
    finally:
        envs.close()
    assert [part.shape for part in layer] == [(1, 3), (1,)]


def test_what_acts_is_an_average_of_policies(pendulum: Any) -> None:
    present = pendulum._model.policy.actor_state
    observations = np.random.RandomState(0).normal(0, 1, (100, 3)).astype(np.float32)
    now = pendulum._model.predict(observations, deterministic=True)[0]
    averaged = _averaged_actions(pendulum, observations)
    assert np.abs(now - averaged).max() > 1e-4
    before = pendulum._average["params"]["Dense_0"]["bias"]
    pendulum._add_to_average()
    share = 2 / learner._AVERAGED  # of two gradient steps
    share = max(share, 3 / (pendulum.actions_taken - SMALL.random_steps))  # as long as it is large
    expected = before + share * (present.params["Dense_0"]["bias"] - before)
    found = pendulum._average["params"]["Dense_0"]["bias"]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7)  # float32


@pytest.mark.parametrize("name", TABLE)
def test_each_number_of_a_row_reaches_the_algorithm(name: str) -> None:
    row = TABLE[name]
    given = learner._arguments(row, None)
    assert given["learning_rate"] == row.learning_rate
    assert given["batch_size"] == row.batch_size
    assert given["gamma"] == row.discount
    assert given["learning_starts"] == row.random_steps
    assert given["gradient_steps"] == max(1, round(row.num_envs * row.updates))
    assert given["buffer_size"] <= row.memory
    assert given["policy_kwargs"]["net_arch"] == {"pi": [*row.actor], "qf": [*row.critic]}


def test_the_algorithm_has_the_numbers_that_it_is_given(pendulum: Any) -> None:
    model = pendulum._model
    assert (model.batch_size, model.gamma, model.learning_starts) == (16, SMALL.discount, 60)
    assert model.gradient_steps == 2
    assert model.replay_buffer.buffer_size == 250 // 3
    sizes = [weight.shape for weight, _ in pendulum.layers()]
    assert sizes == [(16, 3), (16, 16), (1, 16)]
    critic = model.policy.qf_state.params["VmapCritic_0"]
    assert critic["Dense_0"]["kernel"].shape == (2, 4, 16)
    assert critic["Dense_1"]["kernel"].shape == (2, 16, 1)
