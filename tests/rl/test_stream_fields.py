"""Model fields that a task draws once from each random stream, before its first episode."""

import copy
import pickle
from typing import Any

import numpy as np
import pytest

from limberjack import gym, suite
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import scale
from limberjack.rl.stream_fields import check_not_randomized, set_stream_fields
from limberjack.suite import base, lqr

_TASK = ("lqr", "lqr_6_2")  # draws the stiffness of its springs
_LIMIT: dict[str, Any] = {"time_limit": 0.3}  # ten steps


def _single(seed: int) -> Any:
    return suite.load(*_TASK, {"random": seed, **_LIMIT})


def _batch(num_envs: int, seed: int, **kwargs: Any) -> BatchEnvironment:
    return suite.load_batch(*_TASK, num_envs, 2, seed, _LIMIT, **kwargs)


def _springs(env: Any) -> np.ndarray:
    return env.physics.named.model.jnt_stiffness[:].copy()


def _actions(steps: int) -> np.ndarray:
    return np.random.RandomState(0).uniform(-1, 1, (steps, 2))


def _episodes(env: Any, steps: int = 25) -> list[bytes]:
    """Observations of the steps of more than two episodes."""
    told = [env.reset(), *map(env.step, _actions(steps))]
    return [b"".join(value.tobytes() for value in step.observation.values()) for step in told]


def _rows(batch: Any, steps: int = 25) -> list[list[bytes]]:
    """The same of each row of a batch."""
    told = [batch.reset()]
    told += [batch.step(np.stack([action] * batch.num_envs)) for action in _actions(steps)]
    return [
        [b"".join(value[row].tobytes() for value in step.observation.values()) for step in told]
        for row in range(batch.num_envs)
    ]


def test_seeds_have_springs_of_their_own_that_all_their_episodes_share() -> None:
    env = _single(0)
    springs = _springs(env)
    assert len(set(springs)) == 6
    _episodes(env)
    np.testing.assert_array_equal(_springs(env), springs)
    np.testing.assert_array_equal(_springs(_single(0)), springs)
    assert not np.isin(_springs(_single(1)), springs).any()


def test_a_row_is_the_single_environment_with_its_own_springs() -> None:
    batch, singles = _batch(5, 3), [_single(3 + row) for row in range(5)]
    np.testing.assert_array_equal(_springs(batch), [_springs(single) for single in singles])
    assert _rows(batch) == [_episodes(single) for single in singles]
    np.testing.assert_array_equal(_springs(batch), [_springs(single) for single in singles])


@pytest.mark.parametrize("randomize", [None, {"body_mass": scale(0.5, 2)}])
def test_a_reseeded_environment_is_a_new_one(randomize: Any) -> None:
    options = {} if randomize is None else {"randomize": randomize}
    new = suite.load(*_TASK, {"random": 7, **_LIMIT}, options)
    env = suite.load(*_TASK, {"random": 0, **_LIMIT}, options)
    _episodes(env, 13)
    env.reseed(7)
    np.testing.assert_array_equal(_springs(env), _springs(new))
    assert _episodes(env) == _episodes(new)
    batch = _batch(2, 6, environment_kwargs=options)
    new.reseed(7)
    assert _rows(batch)[1] == _episodes(new)
    batch.reset(seeds=[None, 7])
    new.reseed(7)
    new.reset()
    np.testing.assert_array_equal(_springs(batch)[1], _springs(new))
    np.testing.assert_array_equal(batch.physics.data.qpos[1], new.physics.data.qpos)


def test_rows_that_get_new_seeds_get_their_springs_and_others_keep_theirs() -> None:
    batch = _batch(4, 0)
    batch.reset()
    before = _springs(batch)
    batch.reset([1, 3], seeds=[20, None])
    after = _springs(batch)
    np.testing.assert_array_equal(after[1], _springs(_single(20)))
    np.testing.assert_array_equal(after[[0, 2, 3]], before[[0, 2, 3]])
    batch.reset([1])  # continues the stream
    np.testing.assert_array_equal(_springs(batch), after)


def test_gymnasiums_reset_with_a_seed_gives_the_environment_of_that_seed() -> None:
    env, envs = gym.load(*_TASK, **_LIMIT), gym.load_vector(*_TASK, 3, **_LIMIT)
    (batch,) = envs.batches
    for seed in (4, 9):
        expected = _single(seed)
        first = expected.reset().observation
        observation, _ = env.reset(seed=seed)
        observations, _ = envs.reset(seed=seed - 2)
        for name, value in first.items():
            np.testing.assert_array_equal(observation[name], value)
            np.testing.assert_array_equal(observations[name][2], value)
        for found in (_springs(env.environment), _springs(batch)[2]):
            np.testing.assert_array_equal(found, _springs(expected))
    envs.reset(seed=[None, 50, None])
    np.testing.assert_array_equal(_springs(batch)[1], _springs(_single(50)))
    np.testing.assert_array_equal(_springs(batch)[2], _springs(_single(9)))


def test_snapshots_and_rows_carry_the_springs() -> None:
    source, other, batch = _single(3), _single(8), _batch(3, 40)
    source.reset(), batch.reset()
    snapshot = pickle.loads(pickle.dumps(source.snapshot()))
    other.restore(snapshot)
    batch.restore(snapshot, [1])
    batch.copy_row(1, 2)
    for springs in (_springs(other), *_springs(batch)[1:]):
        np.testing.assert_array_equal(springs, _springs(source))
    np.testing.assert_array_equal(_springs(batch)[0], _springs(_single(40)))
    back = _single(0)
    back.restore(batch.snapshot([2]))
    assert _episodes(source) == _episodes(other) == _episodes(back)


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_and_pickles_carry_the_springs(duplicate: Any) -> None:
    env, batch = _single(3), _batch(3, 7)
    env.reset(), batch.reset()
    env_twin, batch_twin = duplicate(env), duplicate(batch)
    np.testing.assert_array_equal(_springs(env_twin), _springs(env))
    np.testing.assert_array_equal(_springs(batch_twin), _springs(batch))
    assert _episodes(env_twin) == _episodes(env)
    assert _rows(batch_twin) == _rows(batch)
    batch_twin.reset([0], seeds=[3])
    np.testing.assert_array_equal(_springs(batch_twin)[0], _springs(env))


def test_environments_do_not_share_springs_although_they_share_a_compiled_model() -> None:
    one, other = _single(0), _single(1)
    springs = _springs(other)
    one.reseed(5)
    np.testing.assert_array_equal(_springs(other), springs)


class _Undeclared(lqr.LQRLevel):
    EPISODE_FIELDS = ()


class _Remembering(lqr.LQRLevel):
    """Keeps on the task what belongs to a stream, so that all rows have the last row's."""

    def begin_stream(self, random: np.random.RandomState) -> Any:
        self._scale = random.uniform(1, 2)
        return {}

    def get_observation(self, physics: Any) -> Any:
        return {"position": self._scale * physics.position()}


def _of(task: base.Task) -> control.Environment:
    return control.Environment(_single(0).physics, task, time_limit=1)


def test_a_task_that_does_not_declare_what_it_draws_is_refused() -> None:
    env = _of(_Undeclared(0.1, random=0, drawn_springs=6))
    message = (
        r"begin_stream of task _Undeclared sets jnt_stiffness; declare EPISODE_FIELDS = "
        r"\('jnt_stiffness',\), so that each row has its own"
    )
    with pytest.raises(ValueError, match=message):
        env.reseed(1)
    with pytest.raises(ValueError, match=message):
        BatchEnvironment.from_environment(env, 2)


def test_a_task_that_keeps_a_streams_draws_on_itself_is_refused_in_a_batch() -> None:
    env = _of(_Remembering(0.1, random=0))
    with pytest.raises(ValueError, match=r"_Remembering sets self\._scale in begin_stream"):
        BatchEnvironment.from_environment(env, 2)


def test_what_is_drawn_for_each_seed_cannot_be_randomised_as_well() -> None:
    options = {"randomize": {"jnt_stiffness": scale(0.9, 1.1)}}
    message = "randomize names jnt_stiffness, which task LQRLevel draws itself for each seed"
    with pytest.raises(ValueError, match=message):
        suite.load(*_TASK, {"random": 0}, options)
    check_not_randomized(lqr.LQRLevel(0.1), ["jnt_stiffness"])  # draws nothing


def test_a_model_of_your_own_keeps_its_springs() -> None:
    stream = np.random.RandomState(3)
    physics = lqr.Physics.from_xml_string(*lqr.get_model_and_assets(6, 2, stream))
    env = control.Environment(physics, lqr.LQRLevel(0.1, random=stream), time_limit=0.3)
    np.testing.assert_array_equal(_springs(env), _springs(_single(3)))
    env.reseed(9)
    batch = BatchEnvironment.from_environment(env, 2, seed=0)
    for springs in (_springs(env), *_springs(batch)):
        np.testing.assert_array_equal(springs, _springs(_single(3)))


def test_a_task_without_the_hook_draws_nothing() -> None:
    class Plain:
        pass

    task: Any = Plain()
    stream = np.random.RandomState(0)
    assert not set_stream_fields(task, stream, _single(0).physics.simulation)
    assert stream.rand() == np.random.RandomState(0).rand()
