"""Subclasses of `Environment` written for dm_control may use names that only ours has."""

import copy
from typing import Any

import dm_env
import numpy as np
import pytest

from limberjack import suite
from limberjack.gym.env import Env
from limberjack.rl import batch_of, control
from limberjack.suite import cartpole
from tests.oracle.same import assert_same

_STEPS = 12


def _plain(seed: int = 0, cls: Any = control.Environment, **kwargs: Any) -> Any:
    physics = cartpole.Physics.from_xml_string(*cartpole.get_model_and_assets())
    task = cartpole.Balance(swing_up=True, sparse=False, random=seed)
    return cls(physics, task, time_limit=0.1, control_timestep=0.01, **kwargs)


class Named(control.Environment):
    """Has attributes and methods of its own, of names that ours uses for something else."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._frames, self._faults, self._looks, self._randomizer = [1], [2], [3], [4]
        self._first = self._name = self._draws = self._seeded = "mine"
        self._closed, self._use, self._last_terms = True, 5, {"a": 1.0}
        self._simulated = "mine"
        own = {"pixels": np.zeros(3), "world": "earth", "success": "maybe", "step_limit": 1}
        own |= {"timed_out": True, "is_running": False, "reward_terms": [], "registration": 7}
        for name, value in (own | {"randomization": None, "_origin": "mine"}).items():
            setattr(self, name, value)

    def _observe(self) -> None:
        raise AssertionError

    _begin = _seen = _in_form = _keep_own = _check_open = _check_action = _put_on = _observe
    _draw_stream = _saved_pictures = _with_faults = _observe


class Repeating(control.Environment):
    """Repeats actions by itself."""

    def __init__(self, *args: Any, action_repeat: int, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.action_repeat = self._action_repeat = action_repeat

    def step(self, action: Any) -> dm_env.TimeStep:
        if self._reset_next_step:
            return self.reset()
        time_step, reward = super().step(action), 0.0
        for _ in range(self.action_repeat - 1):
            reward += time_step.reward or 0.0
            if time_step.last():
                return time_step._replace(reward=reward)
            time_step = super().step(action)
        assert self.action_repeat == self._action_repeat
        return time_step._replace(reward=reward + (time_step.reward or 0.0))


def _actions() -> np.ndarray:
    return np.random.RandomState(1).uniform(-1, 1, (_STEPS, 1))


def _played(env: Any, actions: Any) -> list[Any]:
    return [env.reset(), *(env.step(action) for action in actions)]


def test_an_environment_with_such_names_is_the_plain_one_in_every_bit() -> None:
    assert_same(_played(_plain(cls=Named), _actions()), _played(_plain(), _actions()), "time steps")


def test_the_names_keep_their_values() -> None:
    env = _plain(cls=Named)
    _played(env, _actions())
    for one in (env, copy.copy(env)):
        assert (one.world, one.success, one.step_limit) == ("earth", "maybe", 1)
        assert (one._frames, one._closed, one.reward_terms) == ([1], True, [])
    assert control.Environment.step_limit.of(env) == 10
    assert control.Environment.pixels.of(env) is None
    assert control.Environment.timed_out.of(env) == (_plain_after(_STEPS)).timed_out


def _plain_after(steps: int) -> Any:
    env = _plain()
    _played(env, _actions()[:steps])
    return env


def test_such_an_environment_is_a_row_of_a_batch_and_an_environment_of_gymnasium() -> None:
    env, actions = _plain(cls=Named), _actions()
    expected = _played(_plain(seed=3), actions)
    rows: Any = batch_of(env, 2, seed=3)
    found = [rows.reset(), *(rows.step(np.stack([action] * 2)) for action in actions)]
    for one, own in zip(found, expected, strict=True):
        for name, values in own.observation.items():
            assert_same(one.observation[name][0], values, name)
    gym_env = Env(_plain(seed=3, cls=Named))
    first, _ = gym_env.reset(seed=3)
    assert_same(first["position"], expected[0].observation["position"], "position")
    assert gym_env.step(actions[0])[1] == expected[1].reward


def test_a_snapshot_continues_such_an_environment() -> None:
    env, actions = _plain(cls=Named), _actions()
    env.reset()
    env.step(actions[0])
    snapshot = env.snapshot()
    expected = [env.step(action) for action in actions[1:5]]
    env.restore(snapshot)
    assert_same([env.step(action) for action in actions[1:5]], expected, "time steps")
    assert env.world == "earth"


@pytest.mark.parametrize("kind", ["single", "rows", "gym"])
def test_a_subclass_that_repeats_actions_repeats_them_once(kind: str) -> None:
    env = _plain(cls=Repeating, action_repeat=2)
    action = np.array([0.5])
    if kind == "single":
        env.reset()
        env.step(action)
        steps = env._step_count
    elif kind == "rows":
        rows: Any = batch_of(env, 2, seed=0)
        rows.reset()
        rows.step(np.stack([action, action]))
        steps = rows.environments[1]._step_count
    else:
        gym_env: Any = Env(env)
        gym_env.reset(seed=0)
        gym_env.step(action)
        steps = gym_env.unwrapped.environment._step_count
    assert steps == 2


def test_a_plain_environment_checks_how_often_it_repeats() -> None:
    env = suite.load("cartpole", "swingup", {"random": 0})
    with pytest.raises(ValueError, match="action_repeat is 0"):
        env.action_repeat = 0
    env.action_repeat = 3
    env.reset()
    env.step(np.zeros(1))
    assert env._step_count == 3


def test_a_shallow_copy_has_the_same_physics_as_in_dm_control() -> None:
    env = _plain()
    env.reset()
    other = copy.copy(env)
    assert other.physics is env.physics
    assert other.task is env.task
    other.step([0.0])
    assert (other._step_count, env._step_count) == (1, 0)
    other.action_repeat = 2
    assert env.action_repeat == 1
