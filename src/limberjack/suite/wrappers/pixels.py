"""A wrapper that adds pictures to the observations or replaces them.

    env = pixels.Wrapper(env, render_kwargs={"height": 84, "width": 84, "camera_id": 0})
    env.reset().observation["pixels"]    # (84, 84, 3) uint8

Needs OpenGL. Frames are not stacked, and the order of their axes is not changed.
"""

import collections
from collections.abc import Mapping, MutableMapping
from typing import TypeVar

import dm_env
import numpy as np
from dm_env import specs
from numpy.typing import ArrayLike

from limberjack.rl.observations import of_type
from limberjack.suite.wrappers import _delegating

__all__ = ["STATE_KEY", "Wrapper"]

_V = TypeVar("_V")

# Name of an observation that is a single array, next to the pixels.
STATE_KEY = "state"


class Wrapper(_delegating.Wrapper):
    """Adds a picture to each observation, or replaces the observation by it."""

    def __init__(
        self,
        env: dm_env.Environment,
        pixels_only: bool = True,
        render_kwargs: Mapping[str, object] | None = None,
        observation_key: str = "pixels",
    ) -> None:
        """Wraps `env`, which must have a `physics`, and renders it once for the spec.

        Args:
          env: the environment to wrap; its observations are arrays or dicts of arrays.
          pixels_only: whether to observe only the picture.
          render_kwargs: arguments of `physics.render`: size, camera, `depth`, `segmentation`, ...
          observation_key: name of the picture among the observations.

        Raises:
          ValueError: the observations are of another kind, or one already has this name.
          RenderingError: OpenGL is not available.
        """
        super().__init__(env)
        spec: object = env.observation_spec()
        self._is_dict = isinstance(spec, MutableMapping)
        if not isinstance(spec, MutableMapping | specs.Array):
            raise ValueError(
                f"env.observation_spec() is a {type(spec).__name__}; expected a dict of array "
                "specs or one array spec"
            )
        taken = [STATE_KEY] if isinstance(spec, specs.Array) else list(spec)
        if not pixels_only and observation_key in taken:
            raise ValueError(
                f"observation_key {observation_key!r} is taken; expected none of: "
                f"{', '.join(map(repr, taken))}"
            )
        self._pixels_only = pixels_only
        self._render_kwargs = dict(render_kwargs or {})
        self._observation_key = observation_key
        picture = self._picture()
        self._observation_spec = self._with(
            spec, specs.Array(picture.shape, picture.dtype, name=observation_key)
        )

    def reset(self) -> dm_env.TimeStep:
        """The first time step of a new episode, with its picture."""
        return self._add_pixel_observation(self._env.reset())

    def step(self, action: ArrayLike) -> dm_env.TimeStep:
        """Steps the wrapped environment and renders it."""
        return self._add_pixel_observation(self._env.step(action))

    def observation_spec(self) -> MutableMapping[str, specs.Array]:
        """The spec of the picture, with those of the other observations unless `pixels_only`."""
        return self._observation_spec

    def _add_pixel_observation(self, time_step: dm_env.TimeStep) -> dm_env.TimeStep:
        observation = self._with(time_step.observation, self._picture())
        return time_step._replace(observation=observation)

    def _picture(self) -> np.ndarray:
        return self._env.physics.render(**self._render_kwargs)

    def _with(self, state: object, picture: _V) -> MutableMapping[str, _V]:
        """Observations, or their specs, together with the picture or its spec."""
        if self._pixels_only:
            both = collections.OrderedDict()
        elif self._is_dict and isinstance(state, Mapping):
            both = of_type(state, state)
        else:
            both = collections.OrderedDict({STATE_KEY: state})
        both[self._observation_key] = picture
        return both
