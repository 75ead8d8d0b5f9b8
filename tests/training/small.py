"""Settings with which a run takes a second, and environments of a user's own."""

import collections
import os
from typing import Any

import dm_env
import numpy as np
from dm_env import specs

from limberjack import suite
from limberjack.rl import control
from limberjack.suite import base
from limberjack.training import Settings

__all__ = [
    "SMALL",
    "blind",
    "keeping",
    "make",
    "moving",
    "of_one_array",
    "of_one_number",
    "of_whole_numbers",
    "remembering",
    "repeating",
    "tiring",
    "unseen",
    "worthless",
]

SMALL = Settings(
    steps=1200,
    time_limit=0.4,  # 20 control steps of pendulum
    num_envs=3,
    random_steps=60,
    noise=0.3,
    reward_offset=0.1,
    updates=2 / 3,
    batch_size=16,
    actor=(16, 16),
    critic=(16,),
    n_steps=2,
    memory=250,  # so that the run overwrites transitions
)


def make(seed: int) -> dm_env.Environment:
    """A short pendulum."""
    return suite.load("pendulum", "swingup", task_kwargs={"random": seed, "time_limit": 0.4})


class _Remembering(dm_env.Environment):
    """An environment of another class, whose reward is that of the step before."""

    def __init__(self, inner: dm_env.Environment) -> None:
        self._inner = inner
        self._before = 0.0

    def reset(self) -> dm_env.TimeStep:
        self._before = 0.0
        return self._inner.reset()

    def step(self, action: Any) -> dm_env.TimeStep:
        time_step = self._inner.step(action)
        if time_step.reward is None:
            return time_step
        reward, self._before = self._before, float(np.asarray(time_step.reward))
        return time_step._replace(reward=reward)

    def action_spec(self) -> Any:
        return self._inner.action_spec()

    def observation_spec(self) -> Any:
        return self._inner.observation_spec()


def remembering(seed: int) -> dm_env.Environment:
    """A short pendulum, which is stepped in complete environments."""
    return _Remembering(make(seed))


class _OfOneArray(_Remembering):
    """An environment whose observation has no name."""

    def reset(self) -> dm_env.TimeStep:
        return self._plain(super().reset())

    def step(self, action: Any) -> dm_env.TimeStep:
        return self._plain(super().step(action))

    def observation_spec(self) -> Any:
        return specs.Array((3,), float, "state")

    def _plain(self, time_step: dm_env.TimeStep) -> dm_env.TimeStep:
        parts = [np.ravel(one) for one in time_step.observation.values()]
        return time_step._replace(observation=np.concatenate(parts))


def of_one_array(seed: int) -> dm_env.Environment:
    """A short pendulum that observes one array."""
    return _OfOneArray(make(seed))


def repeating(seed: int) -> dm_env.Environment:
    """A short pendulum, which repeats actions by itself."""
    kwargs = {"random": seed, "time_limit": 0.4}
    return suite.load("pendulum", "swingup", kwargs, {"action_repeat": 4})


def moving(seed: int) -> dm_env.Environment:
    """A short pendulum, with which the working directory becomes another one."""
    os.chdir(os.environ["ELSEWHERE"])
    return make(seed)


class _Blind(base.Task):
    """A task that observes nothing."""

    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict()

    def get_reward(self, physics: Any) -> float:
        return 1.0


class _OfOneNumber(_Blind):
    """A task whose action is a number without an axis."""

    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict(velocity=physics.velocity())

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        return specs.BoundedArray((), float, -1.0, 1.0)

    def before_step(self, action: Any, physics: Any) -> None:
        physics.set_control(np.reshape(action, 1))


class _Tiring(_Blind):
    """A task that remembers how much was done in an episode, and is played in rows."""

    def initialize_episode(self, physics: Any) -> None:
        self._spent = 0.0
        super().initialize_episode(physics)

    def before_step(self, action: Any, physics: Any) -> None:
        self._spent = 0.9 * self._spent + abs(float(action[0]))
        super().before_step(action, physics)

    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict(state=physics.get_state(), time=physics.time())

    def get_reward(self, physics: Any) -> float:
        return 1.0 - 0.1 * self._spent


class _OfWholeNumbers(_Tiring):
    """A task whose action is -1, 0 or 1."""

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        return specs.BoundedArray((1,), int, [-1], [1])


class _Unseen(_Tiring):
    """A task whose observations are no numbers."""

    def get_observation(self, physics: Any) -> Any:
        return collections.OrderedDict(state=np.nan * physics.get_state())


class _Worthless(_Tiring):
    """A task whose rewards are no numbers."""

    def get_reward(self, physics: Any) -> float:
        return np.nan


def _of(task: base.Task) -> dm_env.Environment:
    physics: Any = suite.load("pendulum", "swingup").physics
    return control.Environment(physics, task, time_limit=0.4)


def tiring(seed: int) -> dm_env.Environment:
    """A short pendulum with a task that remembers something."""
    return _of(_Tiring(random=seed))


def worthless(seed: int) -> dm_env.Environment:
    """A short pendulum whose rewards are no numbers."""
    return _of(_Worthless(random=seed))


def blind(seed: int) -> dm_env.Environment:
    """A short pendulum that is not observed."""
    return _of(_Blind(random=seed))


def of_one_number(seed: int) -> dm_env.Environment:
    """A short pendulum whose actions have no axis."""
    return _of(_OfOneNumber(random=seed))


def of_whole_numbers(seed: int) -> dm_env.Environment:
    """A short pendulum whose actions are whole numbers."""
    return _of(_OfWholeNumbers(random=seed))


def unseen(seed: int) -> dm_env.Environment:
    """A short pendulum whose observations are no numbers."""
    return _of(_Unseen(random=seed))


def keeping(seed: int) -> dm_env.Environment:
    """A short pendulum that keeps a function, of which pickle has no name."""
    environment: Any = remembering(seed)
    environment.kept = lambda: 0
    return environment
