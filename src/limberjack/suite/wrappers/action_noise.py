"""A wrapper that adds Gaussian noise to each action.

    env = action_noise.Wrapper(env, scale=0.01)

The noise is drawn from the task's random stream, once per component and step, so it is determined
by the seed; the starts of episodes are drawn from the same stream.
"""

import dm_env
import numpy as np
from numpy.typing import ArrayLike

from limberjack.suite.wrappers import _delegating

__all__ = ["Wrapper"]

_BOUNDS_MUST_BE_FINITE = (
    "env.action_spec() is {action_spec}; expected finite bounds, since the noise is a fraction of "
    "their range"
)


class Wrapper(_delegating.Wrapper):
    """Adds noise to actions; delegates everything else."""

    def __init__(self, env: dm_env.Environment, scale: ArrayLike = 0.01) -> None:
        """Wraps `env`, a control environment whose action bounds are finite.

        Args:
          env: the environment to wrap; the noise is drawn from its `task.random`.
          scale: standard deviation of the noise as a fraction of each component's range, at least
            0; a scalar or one value per component.

        Raises:
          ValueError: a bound is not finite, or `scale` is negative, not finite or misshapen.
        """
        super().__init__(env)
        spec = self.action_spec()
        if not (np.all(np.isfinite(spec.minimum)) and np.all(np.isfinite(spec.maximum))):
            raise ValueError(_BOUNDS_MUST_BE_FINITE.format(action_spec=spec))
        fraction = np.asarray(scale)
        if fraction.shape not in ((), spec.shape):
            raise ValueError(f"scale has shape {fraction.shape}; expected () or {spec.shape}")
        if not (np.all(np.isfinite(fraction)) and np.all(fraction >= 0)):
            raise ValueError(f"scale is {scale}; expected a finite fraction of at least 0")
        self._minimum = spec.minimum
        self._maximum = spec.maximum
        self._shape = spec.shape
        self._noise_std = fraction * (spec.maximum - spec.minimum)

    def step(self, action: ArrayLike) -> dm_env.TimeStep:
        """Steps the wrapped environment with the noisy action, clipped to the spec's bounds.

        Raises:
          ValueError, TypeError: the action has another shape than the spec, or is not numeric or
            not finite; nothing was stepped and no noise was drawn.
        """
        given = _delegating.checked_action(action, self._shape)
        noisy = given + self._env.task.random.normal(scale=self._noise_std)
        return self._env.step(np.clip(noisy, self._minimum, self._maximum))
