"""Several tasks as one vector environment."""

import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from limberjack import gym
from limberjack.gym import ManyVectorEnv

_TASKS = ["pendulum:swingup", "reacher:easy", "lqr:lqr_2_1"]
_ROWS = [2, 3, 2]
_N = 7


def _load(**kwargs: Any) -> Any:
    return gym.load_vector(_TASKS, **{"rows": _ROWS, "time_limit": 0.2, **kwargs})


def _actions(count: int, seed: int = 0) -> np.ndarray:
    return np.random.RandomState(seed).uniform(-1, 1, (count, _N, 2)).astype(np.float32)


def test_spaces_masks_and_facts() -> None:
    envs = _load(dtype="float32")
    assert isinstance(envs, ManyVectorEnv)
    assert envs.single_observation_space.shape == (6,)
    assert envs.single_observation_space.dtype == np.float32
    assert envs.action_space == batch_space(envs.single_action_space, _N)
    assert envs.observation_mask.sum(axis=1).tolist() == [3, 3, 6, 6, 6, 4, 4]
    assert envs.action_mask.sum(axis=1).tolist() == [1, 1, 2, 2, 2, 1, 1]
    assert envs.task_ids.tolist() == [0, 0, 1, 1, 1, 2, 2]
    assert [task.name for task in envs.tasks] == _TASKS
    observations, _ = envs.reset(seed=1)
    assert envs.observation_space.contains(observations)
    assert envs.get_attr("name") == tuple(_TASKS[number] for number in envs.task_ids)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_a_pipelined_one_has_the_same_numbers(mode: str) -> None:
    whole, halves = _load(autoreset_mode=mode), _load(autoreset_mode=mode, pipelined=True)
    assert [half.stop - half.start for half in halves.halves] == [4, 3]
    for name in ("observation_mask", "action_mask", "task_ids"):
        np.testing.assert_array_equal(getattr(halves, name), getattr(whole, name))
    expected, _ = whole.reset(seed=2)
    found, _ = halves.reset(seed=2)
    np.testing.assert_array_equal(found, expected)
    for actions in _actions(9):
        expected, *numbers, _ = whole.step(actions)
        for half, rows in enumerate(halves.halves):
            halves.send(actions[rows], half)
        for _ in range(2):
            seen, *own, own_info = halves.recv()
            rows = own_info["env_id"]
            np.testing.assert_array_equal(seen, expected[rows])
            for one, other in zip(own, numbers, strict=True):
                np.testing.assert_array_equal(one, other[rows])
        if mode == "Disabled":
            ended = numbers[1] | numbers[2]
            if ended.any():
                for envs in (whole, halves):
                    envs.reset(options={"reset_mask": ended})
    found, expected = halves.statistics(), whole.statistics()
    assert found.keys() == expected.keys()
    assert found["lqr:lqr_2_1"].episodes == expected["lqr:lqr_2_1"].episodes == 2
    halves.clear_statistics()
    assert halves.statistics()["lqr:lqr_2_1"].episodes == 0


def test_the_info_says_which_rows_have_a_term() -> None:
    envs = _load()
    envs.reset(seed=0)
    *_, info = envs.step(_actions(1)[0])
    of_reacher = [False, False, True, True, True, False, False]
    assert info["reward_terms"]["_at_target"].tolist() == of_reacher
    assert not info["_success"][5:].any()


def test_a_dict_has_the_masks_and_the_number_of_the_task_beside_the_array() -> None:
    envs, flat = _load(flat=False), _load()
    observations, _ = envs.reset(seed=3)
    expected, _ = flat.reset(seed=3)
    np.testing.assert_array_equal(observations["observations"], expected)
    np.testing.assert_array_equal(observations["action_mask"], flat.action_mask)
    np.testing.assert_array_equal(observations["task_id"], flat.task_ids)
    assert envs.observation_space.contains(observations)


def test_states_and_snapshots_begin_episodes_of_their_rows() -> None:
    envs = _load()
    envs.reset(seed=4)
    envs.step(_actions(1)[0])
    snapshot = pickle.loads(pickle.dumps(envs.batches[0].snapshot()))
    expected = envs.step(_actions(2)[1])[0]
    envs.reset(seed=9, options={"state": snapshot})
    np.testing.assert_array_equal(envs.step(_actions(2)[1])[0], expected)

    given: list[Any] = [None] * _N
    given[1], given[4] = {"qpos": np.array([0.5])}, snapshot.part(3)
    envs.reset(seed=9, options={"state": given})
    assert envs.batches[0].snapshot().step_count.tolist() == [0, 0, 0, 0, 1, 0, 0]
    given[2] = {"qpos": np.zeros(7)}
    with pytest.raises(ValueError, match="row 2"):
        envs.reset(options={"state": given})
    with pytest.raises(TypeError, match="the rows are of several tasks"):
        envs.reset(options={"state": {"qpos": np.zeros((_N, 1))}})
    with pytest.raises(ValueError, match="there are 2 states; expected 7"):
        envs.reset(options={"state": snapshot.part(np.array([0, 1]))})


def test_attributes_are_read_by_row_and_not_set() -> None:
    envs = _load()
    assert envs.get_attr("step_limit") == (10, 10, 10, 10, 10, 7, 7)
    assert len(envs.call("snapshot")) == _N
    with pytest.raises(AttributeError, match="set it in the batch of its task"):
        envs.set_attr("visualize_reward", True)
    with pytest.raises(AttributeError, match="no attribute '_target_size'"):
        envs.get_attr("_target_size")


def test_pictures_of_all_rows() -> None:
    envs = _load(rows=1, render_mode="rgb_array", width=20, height=16)
    envs.reset(seed=0)
    pictures = envs.render()
    assert [picture.shape for picture in pictures] == [(16, 20, 3)] * 3


def test_gymnasium_makes_one_by_its_id() -> None:
    envs = gymnasium.make_vec("limberjack/many-v0", num_envs=6, tasks=_TASKS)
    assert isinstance(envs, ManyVectorEnv)
    assert [task.rows for task in envs.tasks] == [slice(0, 2), slice(2, 4), slice(4, 6)]
    assert envs.spec is not None
    assert envs.spec.max_episode_steps is None  # lqr has no limit
    short = gymnasium.make_vec(
        "limberjack/many-v0", num_envs=2, tasks=_TASKS[:2], max_episode_steps=3, action_repeat=2
    )
    assert short.spec is not None
    assert short.spec.max_episode_steps == 3
    short.reset(seed=0)
    ends = [short.step(np.zeros((2, 2)))[3].all() for _ in range(3)]
    assert ends == [False, False, True]
    endless = gymnasium.make_vec(
        "limberjack/many-v0", num_envs=2, tasks=_TASKS[:2], max_episode_steps=-1
    )
    assert isinstance(endless, ManyVectorEnv)
    assert endless.batches[0].step_limit == np.inf
    with pytest.raises(ValueError, match="num_envs is 4; expected a multiple of 3"):
        gymnasium.make_vec("limberjack/many-v0", num_envs=4, tasks=_TASKS)
    with pytest.raises(ValueError, match="max_episode_steps is 0"):
        gymnasium.make_vec("limberjack/many-v0", num_envs=3, tasks=_TASKS, max_episode_steps=0)
    with pytest.raises(TypeError, match="tasks"):
        gymnasium.make_vec("limberjack/many-v0", num_envs=3)


def test_wrappers_of_gymnasium_take_it() -> None:
    envs = RecordEpisodeStatistics(_load())
    envs.reset(seed=0)
    returns = []
    for actions in _actions(12):
        *_, info = envs.step(actions)
        if "episode" in info:
            returns += info["episode"]["r"][info["_episode"]].tolist()
    own = envs.unwrapped.statistics()  # pyright: ignore[reportAttributeAccessIssue]
    assert len(returns) == sum(task.episodes for task in own.values()) == _N
    total = sum(task.episodes * task.mean_return for task in own.values())
    assert total == pytest.approx(sum(returns), rel=1e-12)  # sums in another order


def test_a_pickled_one_goes_on() -> None:
    envs = _load()
    envs.reset(seed=0)
    envs.step(_actions(1)[0])
    twin = pickle.loads(pickle.dumps(envs))
    for actions in _actions(3, seed=1):
        np.testing.assert_array_equal(envs.step(actions)[0], twin.step(actions)[0])


def test_complete_rows_have_the_numbers_of_vectorised_ones() -> None:
    envs = gym.load_vector(["pendulum:swingup", "reacher:easy"], rows=2, vectorised=False)
    twin = gym.load_vector(["pendulum:swingup", "reacher:easy"], rows=2)
    assert [part.why_rows for part in envs.batches[0].parts] == ["rows were asked for"] * 2
    np.testing.assert_array_equal(envs.reset(seed=3)[0], twin.reset(seed=3)[0])
    for actions in np.random.RandomState(0).uniform(-1, 1, (4, 4, 2)):
        np.testing.assert_array_equal(envs.step(actions)[0], twin.step(actions)[0])
