"""Settings with which a run takes a second, and environments of a user's own."""

import dm_env
import numpy as np

from limberjack import suite
from limberjack.training import Settings

__all__ = ["SMALL", "make", "remembering"]

SMALL = Settings(
    steps=1200,
    num_envs=3,
    random_steps=60,
    batch_size=16,
    actor=(16, 16),
    critic=(16,),
    memory=250,  # so that the run overwrites transitions
)


def make(seed: int) -> dm_env.Environment:
    """A short pendulum."""
    return suite.load("pendulum", "swingup", task_kwargs={"random": seed, "time_limit": 2.0})


class _Remembering(dm_env.Environment):
    """An environment that is no `control.Environment`, with a reward that depends on its past."""

    def __init__(self, inner: dm_env.Environment) -> None:
        self._inner = inner
        self._before = 0.0

    def reset(self) -> dm_env.TimeStep:
        self._before = 0.0
        return self._inner.reset()

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        time_step = self._inner.step(action)
        if time_step.reward is None:
            return time_step
        reward, self._before = self._before, float(time_step.reward)
        return time_step._replace(reward=reward)

    def action_spec(self):  # noqa: ANN201 (as the inner one's)
        return self._inner.action_spec()

    def observation_spec(self):  # noqa: ANN201 (as the inner one's)
        return self._inner.observation_spec()

    def __getattr__(self, name: str) -> object:
        if name.startswith("__") or name == "_inner":
            raise AttributeError(name)
        return getattr(self._inner, name)


def remembering(seed: int) -> dm_env.Environment:
    """A short pendulum in a wrapper."""
    return _Remembering(make(seed))
