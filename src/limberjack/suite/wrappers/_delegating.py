"""Base class of the wrappers, which delegates to the wrapped environment, and action checks."""

from typing import Any

import dm_env
import numpy as np
from dm_env import specs
from numpy.typing import ArrayLike

from limberjack.rl import action_specs

__all__ = ["Wrapper", "checked_action"]


class Wrapper(dm_env.Environment):
    """Delegates everything, extra attributes included, to the wrapped environment."""

    # Any: the wrapped environment may have extra attributes, such as `task` and `physics`.
    def __init__(self, env: Any) -> None:
        """Wraps `env`."""
        self._env = env

    def reset(self) -> dm_env.TimeStep:
        """The first time step of a new episode."""
        return self._env.reset()

    def step(self, action: ArrayLike) -> dm_env.TimeStep:
        """Steps the wrapped environment."""
        return self._env.step(action)

    def action_spec(  # pyright: ignore[reportIncompatibleMethodOverride] (dm_env declares no type)
        self,
    ) -> specs.BoundedArray:
        """The wrapped environment's action spec."""
        return self._env.action_spec()

    def observation_spec(self) -> Any:  # as the wrapped environment has it
        """The wrapped environment's observation spec."""
        return self._env.observation_spec()

    def reward_spec(self) -> specs.Array:
        """The wrapped environment's reward spec."""
        return self._env.reward_spec()

    def discount_spec(self) -> specs.BoundedArray:
        """The wrapped environment's discount spec."""
        return self._env.discount_spec()

    def close(self) -> None:
        """Closes the wrapped environment."""
        self._env.close()

    def __getattr__(self, name: str) -> Any:  # attributes of the wrapped environment
        # Prevents infinite recursion while copying, when `_env` is not yet set. The `__deepcopy__`
        # of what it wraps is not its own.
        if name == "_env" or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._env, name)


def checked_action(action: ArrayLike, shape: tuple[int, ...]) -> np.ndarray:
    """`action` as an array of finite numbers of the given shape.

    A shape of () is not checked here, but by the environment.

    Raises:
      TypeError: the action is not numeric.
      ValueError: it has another shape, or is not finite.
    """
    given = action_specs.as_numbers(action)
    if shape:
        given = action_specs.in_shape(given, shape)
    action_specs.check_finite(given)
    return given
