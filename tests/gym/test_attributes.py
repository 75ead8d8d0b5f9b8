"""`get_attr`, `set_attr` and `call` of a vector environment, of both kinds of batch."""

import collections
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from limberjack import gym, rl, suite
from limberjack.gym import attributes
from limberjack.rl import control
from limberjack.rl.batch import BatchEnvironment
from limberjack.rl.randomize import scale

from .gym_episodes import Falls, assert_same, falling, falling_envs

_WALK = ("humanoid", "walk")


class _Counting(control.Environment):
    """An environment with a method and an attribute of its own."""

    level = 1

    def scaled(self, by: int, plus: int = 0) -> int:
        """A number that depends on the attribute."""
        return self.level * by + plus


def _counting(seed: int) -> _Counting:
    single = suite.load(*_WALK, {"random": seed})
    return _Counting(single.physics, single.task, n_sub_steps=5)


def _envs(num_envs: int = 3, task: tuple[str, str] = _WALK, **kwargs: Any) -> gym.VectorEnv:
    return gym.load_vector(*task, num_envs, num_threads=1, **kwargs)


def _rows(*sizes: int) -> gym.VectorEnv:
    """A vector environment of batches that have environments."""
    starts = [sum(sizes[:i]) for i in range(len(sizes))]
    return gym.VectorEnv(
        *(
            rl.batch_of(_counting, size, 1, seed=start, vectorised=False)
            for size, start in zip(sizes, starts, strict=True)
        )
    )


class _Remembers(Falls):
    """A task whose memory of an episode is declared."""

    EPISODE_ATTRIBUTES = ("level", "offset")
    NAMES = ("a", "b")
    shift = 0.5

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.level, self.offset = 0.0, np.zeros(2, int)
        self.names: tuple[str, ...] = ("a",)
        self.weights = np.ones(3)
        self.is_quick = False
        self.label = "x"

    @property
    def speed(self) -> float:
        """A setting under another name."""
        return self._move_speed

    @speed.setter
    def speed(self, value: float) -> None:
        self._move_speed = value

    @property
    def doubled(self) -> float:
        """A property that cannot be set."""
        return 2 * self.shift


def _remembering(*sizes: int) -> gym.VectorEnv:
    single = falling()
    task = _Remembers(move_speed=0, pure_state=False, random=0)
    env = control.Environment(single.physics, task, time_limit=1, control_timestep=0.025)
    return gym.VectorEnv(*(BatchEnvironment.from_environment(env, n, 1) for n in sizes))


# Rows that share a task.


def test_common_attributes_are_those_of_single_environments() -> None:
    envs: Any = gymnasium.make_vec("limberjack/humanoid-walk-v0", num_envs=2, num_threads=1)
    single = gym.load(*_WALK)
    assert envs.get_attr("dt") == (0.025, 0.025) == (envs.dt, single.dt)
    for name in ("action_space", "observation_space", "layout", "render_mode"):
        assert envs.get_attr(name) == (getattr(single, name),) * 2
    assert envs.get_attr("single_action_space") == (envs.single_action_space,) * 2
    assert [spec.id for spec in envs.get_attr("spec")] == ["limberjack/humanoid-walk-v0"] * 2
    assert envs.get_attr("metadata")[0]["render_fps"] == 40
    envs.close()


def test_attributes_have_the_form_that_gymnasiums_own_vector_environments_give_them() -> None:
    sync = SyncVectorEnv([lambda: gym.load(*_WALK)] * 2)
    envs = _envs(2)
    for each in (sync, envs):
        assert each.get_attr("dt") == each.call("dt") == (0.025, 0.025)
        assert each.call("get_wrapper_attr", "dt") == (0.025, 0.025)
        assert each.call("has_wrapper_attr", "dt") == (True, True)
        assert each.call("has_wrapper_attr", "dtt") == (False, False)
        assert each.call("render") == (None, None)
        with pytest.raises(ValueError, match="values"):
            each.set_attr("dt", [1.0])


def test_attributes_of_the_environment_are_given_by_row() -> None:
    world: Any = {"randomize": {"body_mass": scale(0.5, 2)}, "faults": {"delay": {"actions": 1}}}
    envs = _envs(3, ("manipulator", "bring_ball"), **world)
    singles = [gym.load("manipulator", "bring_ball", **world)] * 3
    assert envs.get_attr("is_running") == (False,) * 3
    assert envs.get_attr("success") == (None,) * 3
    assert envs.get_attr("name") == ("manipulator:bring_ball",) * 3
    envs.reset(seed=0)
    envs.step(np.zeros((3, 5)))
    for name in (
        *("action_repeat", "is_running", "pixels", "randomization"),
        *("reward_terms", "step_limit", "success", "timed_out", "world"),
    ):
        values = envs.get_attr(name)
        for row, single in enumerate(singles):
            single.reset(seed=row)
            single.step(np.zeros(5))
            expected = getattr(single.environment, name)
            if name in ("randomization", "reward_terms"):
                assert_same(dict(values[row]), dict(expected), name)
            else:
                assert values[row] == expected, name
    assert gym.load_vector("lqr", "lqr_2_1", 1).get_attr("step_limit") == (None,)


def test_methods_of_the_environment_are_called_for_each_row() -> None:
    envs = _envs(3, pipelined=True)
    envs.reset(seed=0)
    assert envs.call("control_timestep") == (0.025,) * 3
    assert [spec.shape for spec in envs.call("action_spec")] == [(21,)] * 3
    third = envs.call("snapshot")[2]
    single = gym.load(*_WALK)
    single.reset(options={"state": third})
    assert_same(single.step(np.zeros(21))[1], float(envs.step(np.zeros((3, 21)))[1][2]))


def test_a_setting_of_the_task_is_set_in_all_rows_and_halves() -> None:
    envs = _envs(3, pipelined=True)
    assert envs.get_attr("_move_speed") == (1, 1, 1)
    for values in (10, [10, 10.0, np.float64(10)]):
        envs.set_attr("_move_speed", values)
        assert envs.get_attr("_move_speed") == (10, 10, 10)
    run = gym.load("humanoid", "run")
    envs.reset(seed=0)
    actions = np.random.RandomState(0).uniform(-1, 1, (5, 3, 21))
    run.reset(seed=2)
    for action in actions:
        assert_same(float(envs.step(action)[1][2]), run.step(action[2])[1])


def test_declared_memory_has_a_value_for_each_row() -> None:
    envs = _remembering(2, 1)
    assert envs.get_attr("level") == (0.0, 0.0, 0.0)
    envs.set_attr("level", [1.0, 2, np.float32(3)])
    assert envs.get_attr("level") == (1.0, 2.0, 3.0)
    envs.set_attr("offset", [np.array([1, 2]), [3, 4], (5, 6)])
    np.testing.assert_array_equal(envs.batches[0].task.offset, [[1, 2], [3, 4]])
    np.testing.assert_array_equal(envs.batches[1].task.offset, [[5, 6]])
    envs.get_attr("offset")[0][:] = 9  # a copy
    np.testing.assert_array_equal(envs.batches[0].task.offset, [[1, 2], [3, 4]])
    with pytest.raises(TypeError, match=r"expected an array of shape \(2,\)"):
        envs.set_attr("offset", [[1, 2], [3, 4], [5]])
    with pytest.raises(TypeError, match="'level' is 'high'; expected a value like"):
        envs.set_attr("level", "high")
    np.testing.assert_array_equal(envs.batches[1].task.offset, [[5, 6]])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("shift", 2),
        ("names", [("b", "c")] * 3),
        ("weights", np.zeros(3)),
        ("is_quick", True),
        ("label", "y"),
        ("speed", 4.0),
    ],
)
def test_settings_of_every_plain_kind_can_be_set(name: str, value: Any) -> None:
    envs = _remembering(2, 1)
    envs.set_attr(name, value)
    expected = value[0] if isinstance(value, list) else value
    for seen in envs.get_attr(name):
        np.testing.assert_array_equal(seen, expected)


@pytest.mark.parametrize(
    ("name", "values", "kind", "message"),
    [
        ("_move_sped", 1, AttributeError, "no setting '_move_sped' .* Did you mean '_move_speed'"),
        ("_random", np.random.RandomState(0), AttributeError, "no setting '_random'"),
        ("random", 3, AttributeError, "no setting 'random'"),
        ("visualize_reward", True, AttributeError, "no setting 'visualize_reward'"),
        ("get_reward", 3, AttributeError, r"batch_of\(..., vectorised=False\)"),
        ("GOAL", [("x",)] * 3, AttributeError, "no setting 'GOAL'"),
        ("NAMES", [("x",)] * 3, AttributeError, "no setting 'NAMES'"),
        ("doubled", 1.0, AttributeError, "no setting 'doubled'"),
        ("__class__", 3, AttributeError, "no setting '__class__'"),
        ("dt", 0.5, AttributeError, "all rows share the attribute 'dt': give it where"),
        ("render_mode", "rgb_array", AttributeError, "all rows share the attribute"),
        ("_move_speed", [1, 2], ValueError, "there are 2 values of '_move_speed'; expected 3"),
        ("_move_speed", [1, 1, 2], ValueError, r"differs between rows.*vectorised=False"),
        ("_move_speed", [2, 1, 1], ValueError, "differs between rows"),
        ("_move_speed", "fast", TypeError, "'_move_speed' is 'fast'; expected a value like 0"),
        ("_move_speed", True, TypeError, "expected a value like 0"),
        ("is_quick", 1, TypeError, "expected a value like False"),
        ("label", 3, TypeError, "expected a value like 'x'"),
        ("weights", np.zeros(2), TypeError, r"expected an array of shape \(3,\)"),
        ("weights", [np.zeros(3), np.zeros(3), np.ones(3)], ValueError, "differs between rows"),
        ("_pure_state", True, ValueError, "'_pure_state' .* changes the observations"),
    ],
)
def test_what_rows_cannot_have_is_refused_and_nothing_is_set(
    name: str, values: Any, kind: Any, message: str
) -> None:
    envs = _remembering(1, 2)
    before = [dict(vars(batch.task)) for batch in envs.batches]
    with pytest.raises(kind, match=message):
        envs.set_attr(name, values)
    for batch, kept in zip(envs.batches, before, strict=True):
        assert vars(batch.task).keys() == kept.keys()
        assert all(vars(batch.task)[key] is value for key, value in kept.items())


def test_a_setting_that_makes_rows_differ_from_single_environments_is_refused() -> None:
    class Mixes(Falls):
        """Its reward depends on all rows if it is told so."""

        mixes = False

        def get_reward(self, physics: Any) -> Any:
            height = physics.head_height()
            return height / (1 + np.linalg.norm(height)) if self.mixes else height

    task = Mixes(move_speed=0, pure_state=False, random=0)
    env = control.Environment(falling().physics, task, time_limit=1, control_timestep=0.025)
    envs, twin = (gym.VectorEnv(BatchEnvironment.from_environment(env, 3, 1)) for _ in range(2))
    for each in (envs, twin):
        each.reset(seed=0)
    with pytest.raises(ValueError, match="reward of task Mixes"):
        envs.set_attr("mixes", True)
    assert envs.get_attr("mixes") == (False,) * 3
    assert_same(envs.step(np.zeros((3, 21))), twin.step(np.zeros((3, 21))))


@pytest.mark.parametrize("name", ["get_reward", "_random", "physics", "task", "step", "__class__"])
def test_other_attributes_are_refused_with_the_way_out(name: str) -> None:
    envs = _envs()
    with pytest.raises(AttributeError, match=rf"no attribute '{name}'.*vectorised=False"):
        envs.get_attr(name)


def test_a_misspelt_name_is_answered_with_the_nearest() -> None:
    envs = _envs()
    with pytest.raises(AttributeError, match=r"no attribute 'dtt'\. Did you mean 'dt'\?"):
        envs.get_attr("dtt")
    with pytest.raises(AttributeError, match=r"no attribute 'succes'\. Did you mean 'success'\?"):
        envs.get_attr("succes")
    with pytest.raises(AttributeError, match=r"no method 'rendr'\. Did you mean 'render'\?"):
        envs.call("rendr")
    with pytest.raises(AttributeError, match="no method 'reset'"):
        envs.call("reset")


def test_values_are_copies() -> None:
    envs = _remembering(2)
    envs.get_attr("weights")[0][:] = 7
    assert envs.get_attr("weights")[1].tolist() == [1, 1, 1]
    given = np.zeros(3)
    envs.set_attr("weights", given)
    rows = _rows(2)
    rows.set_attr("weights", given)
    given[:] = 7
    assert envs.get_attr("weights")[1].tolist() == [0, 0, 0]
    rows.get_attr("weights")[0][:] = 5  # the environment's own
    assert [one.tolist() for one in rows.get_attr("weights")] == [[5, 5, 5], [0, 0, 0]]


def test_a_half_that_is_stepping_and_a_closed_environment_refuse() -> None:
    envs = falling_envs(1, 1)
    envs.reset(seed=0)
    envs.send(np.zeros((1, 21)), 0)
    for use in (
        lambda: envs.get_attr("dt"),
        lambda: envs.call("render"),
        lambda: envs.set_attr("_move_speed", 1),
    ):
        with pytest.raises(RuntimeError, match=r"halves \[0\] were sent"):
            use()
    envs.recv()
    envs.close()
    with pytest.raises(gymnasium.error.ClosedEnvironmentError):
        envs.get_attr("dt")


# Rows that are environments.


def test_environments_have_attributes_and_methods_of_their_own() -> None:
    envs = _rows(2, 1)
    assert attributes.are_environments(envs)
    assert envs.get_attr("dt") == (0.025,) * 3
    assert envs.get_attr("level") == (1, 1, 1)
    envs.set_attr("level", [1, 2, 3])
    assert envs.get_attr("level") == (1, 2, 3)
    assert envs.call("scaled", 10, plus=1) == (11, 21, 31)
    envs.set_attr("level", 5)
    assert envs.call("scaled", 2) == (10, 10, 10)
    envs.set_attr("label", "x")  # a new one, as in Gymnasium
    assert envs.get_attr("label") == ("x",) * 3
    with pytest.raises(AttributeError, match="nothing"):
        envs.get_attr("nothing")
    envs.close()


def test_settings_of_tasks_may_differ_between_environments_and_last() -> None:
    for build in (_counting, suite.load(*_WALK)):
        envs = gym.VectorEnv(rl.batch_of(build, 3, 1, vectorised=False))
        assert envs.get_attr("_move_speed") == (1, 1, 1)
        envs.set_attr("_move_speed", [0, 1, 10])
        for seed in (None, 0):  # environments that another seed replaces have them too
            envs.reset(seed=seed)
            assert envs.get_attr("_move_speed") == (0, 1, 10)
        rewards = envs.step(np.ones((3, 21)))[1]
        for row, task in enumerate(("stand", "walk", "run")):
            single = gym.load("humanoid", task)
            single.reset(seed=row)
            assert single.step(np.ones(21))[1] == rewards[row]
        envs.close()


def test_a_method_of_some_rows_is_called_for_these_only() -> None:
    envs = _rows(2, 2)
    envs.set_attr("level", [1, 2, 3, 4])
    assert attributes.call(envs, "scaled", (10,), {}, [1, 3]) == [20, 40]
    assert attributes.call(envs, "scaled", (10,), {}, [3]) == [40]
    seen: collections.Counter[int] = collections.Counter()
    for row, environment in enumerate(e for batch in envs.batches for e in batch.environments):
        environment.mark = lambda row=row: seen.update([row])
    attributes.call(envs, "mark", (), {}, [0, 2])
    assert seen == {0: 1, 2: 1}
    envs.close()
