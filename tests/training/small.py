"""Settings with which a run takes a second, and environments of a user's own."""

from typing import Any

import dm_env
import numpy as np

from limberjack import suite
from limberjack.training import Settings

__all__ = ["SMALL", "make", "remembering"]

SMALL = Settings(
    steps=1200,
    time_limit=0.4,  # 20 control steps of pendulum
    num_envs=3,
    random_steps=60,
    noise=0.3,
    reward_offset=0.1,
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
