"""A wrapper that rescales actions to bounds of your choice.

    env = action_scale.Wrapper(env, minimum=-1.0, maximum=1.0)

Each component is mapped linearly from [minimum, maximum] to the range of the wrapped environment's
spec. Actions are not clipped.
"""

import dm_env
import numpy as np
from dm_env import specs
from numpy.typing import ArrayLike

from limberjack.suite.wrappers import _delegating

__all__ = ["Wrapper"]

_ACTION_SPEC_MUST_BE_BOUNDED_ARRAY = (
    "env.action_spec() is {}; expected one dm_env.specs.BoundedArray, whose range can be scaled"
)
_MUST_BE_FINITE = "{name} is {bounds}; expected finite values, a range that can be scaled"
_MUST_BROADCAST = (
    "{name} is {bounds}; expected a scalar, or an array that broadcasts to the action's shape "
    "{shape}"
)
_MUST_BE_BELOW = "minimum is {minimum} and maximum {maximum}; expected minimum < maximum throughout"


class Wrapper(_delegating.Wrapper):
    """Scales actions; delegates everything else."""

    def __init__(self, env: dm_env.Environment, minimum: ArrayLike, maximum: ArrayLike) -> None:
        """Wraps `env`, whose action spec must be one bounded array with finite bounds.

        Args:
          env: the environment to wrap.
          minimum: lower bounds of the new spec, finite; a scalar or one value per component.
          maximum: upper bounds, likewise.

        Raises:
          ValueError: the spec or the bounds do not meet these requirements.
        """
        super().__init__(env)
        spec = env.action_spec()
        if not isinstance(spec, specs.BoundedArray):
            raise ValueError(_ACTION_SPEC_MUST_BE_BOUNDED_ARRAY.format(spec))
        low, high = np.array(minimum), np.array(maximum)
        _check_bounds(low, "minimum", spec.shape)
        _check_bounds(high, "maximum", spec.shape)
        _check_bounds(spec.minimum, "env.action_spec().minimum", spec.shape)
        _check_bounds(spec.maximum, "env.action_spec().maximum", spec.shape)
        if not np.all(low < high):
            raise ValueError(_MUST_BE_BELOW.format(minimum=low, maximum=high))
        self._from = low
        self._to = spec.minimum
        self._scale = (spec.maximum - spec.minimum) / (high - low)
        self._dtype = spec.dtype
        self._action_spec = spec.replace(
            minimum=low, maximum=high, dtype=np.result_type(low, high, spec.dtype)
        )

    def step(self, action: ArrayLike) -> dm_env.TimeStep:
        """Steps the wrapped environment with the scaled action.

        Raises:
          ValueError, TypeError: the action has another shape than the spec, or is not numeric or
            not finite; nothing was stepped.
        """
        given = _delegating.checked_action(action, self._action_spec.shape)
        scaled = self._to + self._scale * (given - self._from)
        return self._env.step(scaled.astype(self._dtype, copy=False))

    def action_spec(self) -> specs.BoundedArray:
        """The wrapped environment's spec with the new bounds."""
        return self._action_spec


def _check_bounds(bounds: ArrayLike, name: str, shape: tuple[int, ...]) -> None:
    """Raises ValueError for bounds that are not finite or do not broadcast to `shape`."""
    if not np.all(np.isfinite(bounds)):
        raise ValueError(_MUST_BE_FINITE.format(name=name, bounds=bounds))
    try:
        np.broadcast_to(bounds, shape)
    except ValueError:
        message = _MUST_BROADCAST.format(name=name, bounds=bounds, shape=shape)
        raise ValueError(message) from None
