"""The `repr` of environments, batches and snapshots, in Gymnasium too."""

import copy
import pickle

import gymnasium
import numpy as np

from limberjack import gym, suite
from limberjack.rl import control
from limberjack.rl.represented import Description, represented
from tests import plain_domain

_ACTION = np.zeros(21)


def test_an_environment_shows_task_seed_and_step() -> None:
    env = suite.load("humanoid", "walk", {"random": 3})
    assert repr(env) == "<Environment humanoid:walk, seed 3, not reset yet>"
    env.reset()
    env.step(_ACTION)
    env.step(_ACTION)
    assert repr(env) == "<Environment humanoid:walk, seed 3, step 2 of 1000>"
    assert repr(pickle.loads(pickle.dumps(env))) == repr(copy.deepcopy(env)) == repr(env)
    env.reseed(8)
    env.reset()
    assert repr(env) == "<Environment humanoid:walk, seed 8, step 0 of 1000>"
    env.close()
    assert "humanoid:walk" in repr(env)


def test_an_episode_that_has_ended_shows_its_last_step() -> None:
    env = suite.load("humanoid", "walk", {"random": 3, "time_limit": 0.05})
    env.reset()
    while not env.step(_ACTION).last():
        pass
    assert repr(env) == "<Environment humanoid:walk, seed 3, step 2 of 2>"


def test_a_seed_that_is_not_known_is_not_shown() -> None:
    env = suite.load("humanoid", "walk", {"random": np.random.RandomState(3)})
    assert "seed" not in repr(env)
    env = suite.load("humanoid", "walk", {"random": np.int64(3)})
    assert "seed 3" in repr(env)
    snapshot = env.snapshot()
    env.task._random = np.random.RandomState(4)  # as programs written for dm_control do
    assert "seed" not in repr(env)
    env = suite.load("humanoid", "walk", {"random": 3})
    env.restore(snapshot)  # the stream's state comes from elsewhere
    assert "seed" not in repr(env)


def test_an_environment_of_ones_own_is_named_after_its_task() -> None:
    env = plain_domain.push()
    env.reset()
    assert repr(env) == "<Environment Push, step 0 of 25>"
    endless = control.Environment(env.physics, env.task)
    endless.reset()
    assert repr(endless) == "<Environment Push, step 0>"


def test_an_environment_that_is_not_initialised_has_a_repr() -> None:
    class Late(control.Environment):
        def __init__(self) -> None: ...

    assert repr(Late()) == "<Late NoneType, not reset yet>"


def test_a_batch_shows_its_rows() -> None:
    batch = suite.load_batch("humanoid", "walk", 3, seed=5, task_kwargs={"time_limit": 1.0})
    assert repr(batch) == "<BatchEnvironment humanoid:walk, 3 rows, seeds 5 to 7, not reset yet>"
    batch.reset()
    batch.step(np.zeros((3, 21)))
    assert repr(batch) == "<BatchEnvironment humanoid:walk, 3 rows, seeds 5 to 7, step 1 of 40>"
    batch.reset([1], seeds=[9])
    expected = "<BatchEnvironment humanoid:walk, 3 rows, seeds 5, 9, 7, steps 0 to 1 of 40>"
    assert repr(batch) == expected
    assert repr(batch.snapshot([0, 1])) == "<Snapshot humanoid:walk, 2 rows, steps 0 to 1>"
    batch.copy_row(0, 2)
    assert "seed" not in repr(batch)
    batch.close()
    assert "3 rows" in repr(batch)


def test_a_snapshot_shows_its_task_and_steps() -> None:
    env = suite.load("humanoid", "walk", {"random": 3})
    env.reset()
    env.step(_ACTION)
    assert repr(env.snapshot()) == "<Snapshot humanoid:walk, 1 row, step 1>"
    own = plain_domain.push()
    own.reset()
    assert repr(own.snapshot()) == "<Snapshot Push, 1 row, step 0>"


def test_gymnasiums_environments_show_it_within_their_wrappers() -> None:
    env = gymnasium.make("limberjack/humanoid-walk-v0")
    env.reset(seed=2)
    inner = "<Env humanoid:walk, seed 2, step 0>"
    assert repr(env.unwrapped) == str(env.unwrapped) == inner
    assert repr(env).count(inner) == 1


def test_halves_are_shown_as_one() -> None:
    envs = gym.load_vector("humanoid", "walk", 5, pipelined=True, time_limit=1.0)
    envs.reset(seed=2)
    assert repr(envs) == "<VectorEnv humanoid:walk, 5 rows, seeds 2 to 6, step 0 of 40>"


def test_many_seeds_are_shown_only_in_a_row() -> None:
    steps = [0] * 5
    in_a_row = represented(1, Description("task", 5, [3, 4, 5, 6, 7], steps))
    assert in_a_row == "<int task, 5 rows, seeds 3 to 7, step 0>"
    mixed = represented(1, Description("task", 5, [3, 4, 5, 6, 8], steps))
    assert mixed == "<int task, 5 rows, step 0>"
