"""Observations in the form of Gymnasium: a dict or one flat array of numbers, and pictures.

layout = Observations(environment.observation_spec(), flat=True, dtype="float32").layout
for name, columns, shape in layout:
    print(name, flat_observation[..., columns].reshape(*leading, *shape))

Pictures are uint8, 'pixels' in the dict of observations. With `flat` the other observations are
'state' beside them; with `only=True` the observation is the array of pictures itself.
"""

import collections
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt
from dm_env import specs
from gymnasium import spaces

from limberjack.rl.action_specs import open_bounds
from limberjack.rl.pixels import PIXELS_KEY, Pixels

__all__ = [
    "STATE_KEY",
    "AnyObservation",
    "Info",
    "Observation",
    "Observations",
    "Part",
    "PixelObservations",
    "action_space",
    "observations_of",
    "specs_of_one_row",
]

STATE_KEY = "state"  # the name of the flat array beside the pictures

# A state beyond this has diverged in MuJoCo's terms, so no observation is larger.
_BOUND = mujoco.mjMAXVAL


# Depends on the arguments of an environment: flat, or a dict.
Observation = np.ndarray | dict[str, np.ndarray]
# Any: the same for users, who know which one they asked for.
AnyObservation = Any
# Any: as in Gymnasium, whose users know what each name stands for.
Info = dict[str, Any]


class Part(NamedTuple):
    """Position of an observation in the flat array: in `slice`, in row-major order."""

    name: str
    slice: slice
    shape: tuple[int, ...]


class Observations:
    """The form of observations: dict or flat, and the number type.

    `layout` has the parts of the flat array, in the order of the array and of the dict; `space` is
    the space of one simulation's observation.
    """

    def __init__(self, of_one: Mapping[str, specs.Array], flat: bool, dtype: npt.DTypeLike) -> None:
        """Take the specs of one simulation's observations.

        Raises:
          ValueError: `dtype` is neither float64 nor float32.
        """
        self.dtype = _float_type(dtype)
        self.flat = flat
        self.layout = _layout({name: tuple(spec.shape) for name, spec in of_one.items()})
        self._size = self.layout[-1].slice.stop if self.layout else 0
        self.space: spaces.Space = self._box((self._size,)) if flat else self._dict_space()

    def of_one(self, observation: Mapping[str, np.ndarray]) -> Observation:
        """One simulation's observation, in arrays of its own."""
        if not self.flat:
            return {part.name: np.array(observation[part.name], self.dtype) for part in self.layout}
        joined = np.empty(self._size, self.dtype)
        for name, where, _ in self.layout:
            joined[where] = np.ravel(observation[name])
        return joined

    def buffer(self, num_envs: int) -> np.ndarray | None:
        """An array for `of_batch` to write to; None where it does not need one."""
        return np.empty((num_envs, self._size), self.dtype) if self.flat else None

    def of_batch(
        self, observation: Mapping[str, np.ndarray], buffer: np.ndarray | None
    ) -> Observation:
        """A batch's observation, in arrays of its own or in the buffer.

        Args:
          observation: arrays of (num_envs, ...) that are not used elsewhere.
          buffer: the result of `buffer`.
        """
        if buffer is None:
            # Numbers of the right type are not copied.
            return {
                part.name: observation[part.name].astype(self.dtype, copy=False)
                for part in self.layout
            }
        for name, where, _ in self.layout:
            buffer[:, where] = observation[name].reshape(len(buffer), -1)
        return buffer

    def copies_of_rows(self, observation: Observation, rows: np.ndarray) -> list[Observation]:
        """Some rows of an observation of `of_batch`, each in the form of `of_one`."""
        if isinstance(observation, np.ndarray):
            return list(observation[rows])
        kept = {name: values[rows] for name, values in observation.items()}
        return [{name: values[i, ...] for name, values in kept.items()} for i in range(len(rows))]

    def _dict_space(self) -> spaces.Dict:
        boxes = [(part.name, self._box(part.shape)) for part in self.layout]
        return spaces.Dict(collections.OrderedDict(boxes))

    def _box(self, shape: tuple[int, ...]) -> spaces.Box:
        return spaces.Box(-_BOUND, _BOUND, shape, self.dtype.type)


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
        parts = {STATE_KEY: self.space} if flat else self._dict_space().spaces
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
        named = {STATE_KEY: state} if isinstance(state, np.ndarray) else state
        return {**named, PIXELS_KEY: pixels}


def observations_of(
    of_one: Mapping[str, specs.Array], flat: bool, dtype: npt.DTypeLike, pixels: Pixels | None
) -> Observations:
    """The form of observations with these specs.

    They have pictures if `pixels` is given, or if a wrapper adds some.

    Raises:
      ValueError: `dtype` is neither float64 nor float32.
    """
    if pixels is not None:
        return PixelObservations(of_one, flat, dtype, pixels.only)
    seen = of_one.get(PIXELS_KEY)
    if seen is None or seen.dtype != np.uint8:
        return Observations(of_one, flat, dtype)
    return PixelObservations(of_one, flat, dtype, only=len(of_one) == 1)


def specs_of_one_row(batched: Mapping[str, specs.Array]) -> dict[str, specs.Array]:
    """The specs of one simulation's observations, from those of a batch."""
    return {name: specs.Array(spec.shape[1:], spec.dtype) for name, spec in batched.items()}


def action_space(
    spec: specs.BoundedArray, dtype: npt.DTypeLike = "float32"
) -> spaces.Box | spaces.Discrete:
    """The space of one simulation's actions, float32 as in Gymnasium's MuJoCo environments.

    It lies within the spec: bounds that the type cannot represent are rounded inward. Where the
    spec is unlimited, the bounds are infinite, so that Gymnasium samples a normal distribution.
    Actions that are whole numbers keep their type; a `DiscreteArray` is a `Discrete`.
    """
    if isinstance(spec, specs.DiscreteArray):
        return spaces.Discrete(spec.num_values)
    if spec.dtype.kind in "iu":
        least, most = (np.broadcast_to(at, spec.shape) for at in (spec.minimum, spec.maximum))
        return spaces.Box(least, most, spec.shape, spec.dtype.type)
    number = _float_type(dtype)
    low, high = open_bounds(spec)
    least, most = low.astype(number), high.astype(number)
    least = np.where(least < low, np.nextafter(least, np.inf, dtype=number), least)
    most = np.where(most > high, np.nextafter(most, -np.inf, dtype=number), most)
    return spaces.Box(least, most, spec.shape, number.type)


def _layout(shapes: Mapping[str, tuple[int, ...]]) -> tuple[Part, ...]:
    parts, start = [], 0
    for name, shape in shapes.items():
        stop = start + math.prod(shape)
        parts.append(Part(name, slice(start, stop), shape))
        start = stop
    return tuple(parts)


def _float_type(dtype: npt.DTypeLike) -> np.dtype:
    try:
        found = np.dtype(dtype)
    except TypeError:
        found = np.dtype(object)
    if dtype is None or found.name not in ("float64", "float32"):
        raise ValueError(f"dtype is {dtype!r}; expected 'float64' or 'float32'")
    return found
