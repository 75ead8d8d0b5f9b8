"""Observations with pictures in the form of Gymnasium: uint8, beside numbers or alone.

    env = load("humanoid", "walk", flat=True, pixels={"camera": "side", "frame_stack": 3})
    env.observation_space    # Dict: 'state' (67,) float64, 'pixels' (84, 84, 9) uint8

The pictures are 'pixels' in the dict of observations. With `flat` the other observations are
'state'; with `only=True` the observation is the array of pictures itself.
"""

import collections
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from dm_env import specs
from gymnasium import spaces

from limberjack.gym.observations import Observation, Observations
from limberjack.rl.pixels import PIXELS_KEY, Pixels

__all__ = ["STATE_KEY", "PixelObservations", "observations_of"]

STATE_KEY = "state"  # the name of the flat array beside the pictures


class PixelObservations(Observations):
    """The form of observations with pictures.

    `layout` has the parts of the flat array, none of which is a picture.
    """

    def __init__(
        self, of_one: Mapping[str, specs.Array], flat: bool, dtype: npt.DTypeLike, only: bool
    ) -> None:
        """Take the specs of one simulation's observations; `only` keeps the pictures alone."""
        numbers = {} if only else {n: s for n, s in of_one.items() if n != PIXELS_KEY}
        super().__init__(numbers, flat, dtype)
        self._only = only
        box = spaces.Box(0, 255, of_one[PIXELS_KEY].shape, np.uint8)
        if only:
            self.space = box
            return
        parts = {STATE_KEY: self.space} if flat else self.space.spaces
        self.space = spaces.Dict(collections.OrderedDict({**parts, PIXELS_KEY: box}))

    def of_one(self, observation: Mapping[str, np.ndarray]) -> Observation:
        """One simulation's observation, in arrays of its own."""
        pixels = np.asarray(observation[PIXELS_KEY])
        return pixels if self._only else self._with(super().of_one(observation), pixels)

    def of_batch(
        self, observation: Mapping[str, np.ndarray], buffer: np.ndarray | None
    ) -> Observation:
        """A batch's observation in arrays of its own; with a buffer, all but the pictures in it."""
        pixels = observation[PIXELS_KEY]
        return pixels if self._only else self._with(super().of_batch(observation, buffer), pixels)

    def _with(self, state: Observation, pixels: np.ndarray) -> dict[str, np.ndarray]:
        named = {STATE_KEY: state} if self.flat else state
        return {**named, PIXELS_KEY: pixels}


def observations_of(
    of_one: Mapping[str, specs.Array], flat: bool, dtype: npt.DTypeLike, pixels: Pixels | None
) -> Observations:
    """The form of observations with these specs.

    They have pictures unless `pixels` is None, or if there are some from a wrapper.

    Raises:
      ValueError: `dtype` is neither float64 nor float32.
    """
    if pixels is not None:
        return PixelObservations(of_one, flat, dtype, pixels.only)
    seen = of_one.get(PIXELS_KEY)
    if seen is None or seen.dtype != np.uint8:
        return Observations(of_one, flat, dtype)
    return PixelObservations(of_one, flat, dtype, only=len(of_one) == 1)
