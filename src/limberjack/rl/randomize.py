"""Domain randomisation: model fields drawn at the start of each episode.

    randomize = {"geom_friction": scale(0.7, 1.3), "opt.gravity": shift([-1, 0, 0], [1, 0, 0])}
    env = suite.load("humanoid", "walk", environment_kwargs={"randomize": randomize})
    env.reset()
    env.randomization["geom_friction"]     # the values drawn

`randomize` maps fields of `mujoco.MjModel` (or of its options, as 'opt.gravity') to distributions:
`scale`, `shift`, or a function of a `RandomState` and the nominal values that returns values of the
same shape. Draws use a separate stream, so starts are the same as without randomisation. A row of a
batch draws the same values as the single environment with its seed.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from limberjack.rl.contract import SimulatedPhysics

__all__ = ["Draw", "Randomizer", "scale", "shift", "show_drawn", "stream_beside"]

Draw = Callable[[np.random.RandomState, np.ndarray], ArrayLike]


@dataclasses.dataclass(frozen=True)
class scale:  # noqa: N801 (reads as a verb where it is used)
    """Nominal values times a factor drawn uniformly per object, for example per geom."""

    lower: float
    upper: float

    def __call__(self, random: np.random.RandomState, nominal: np.ndarray) -> np.ndarray:
        shape = nominal.shape[:1] + (1,) * (nominal.ndim - 1)
        return nominal * random.uniform(self.lower, self.upper, shape)


@dataclasses.dataclass(frozen=True)
class shift:  # noqa: N801
    """Nominal values plus an offset drawn uniformly per element; the bounds broadcast."""

    lower: float | Sequence[float] | np.ndarray
    upper: float | Sequence[float] | np.ndarray

    def __call__(self, random: np.random.RandomState, nominal: np.ndarray) -> np.ndarray:
        return nominal + random.uniform(self.lower, self.upper, nominal.shape)


def stream_beside(random: np.random.RandomState, *apart: int) -> np.random.RandomState:
    """A stream seeded from the current state of another stream, which is not advanced.

    Args:
      random: the other stream.
      apart: numbers that set the stream apart from others beside the same one.
    """
    _, key, position, *_ = random.get_state(legacy=True)
    seed = np.append(np.asarray(key, np.uint32), np.array([position, *apart], np.uint32))
    return np.random.RandomState(seed)


class Randomizer:
    """Distributions of model fields, validated against a model."""

    def __init__(self, mapping: Mapping[str, Draw], physics: SimulatedPhysics) -> None:
        """Uses the model's current values as the nominal ones.

        Raises:
          ValueError: the model has no such field, or it is part of the model's structure.
          TypeError: `mapping` is not a mapping, or a distribution is not a function.
        """
        if not isinstance(mapping, Mapping):
            raise TypeError(f"randomize is {mapping!r}; expected a mapping of fields to draws")
        for name, draw in mapping.items():
            if not callable(draw) or isinstance(draw, type):
                raise TypeError(
                    f"randomize[{name!r}] is {draw!r}; expected scale(...), shift(...) or a "
                    "function of a RandomState and the nominal values"
                )
        self.mapping = dict(mapping)
        self.fields = tuple(self.mapping)
        self._nominal = physics.nominal_fields(self.fields)

    def draw(self, random: np.random.RandomState) -> dict[str, np.ndarray]:
        """Values for one episode, by field.

        Raises:
          ValueError: drawn values have another shape or are not finite.
          ValueError, TypeError: a draw raises an error, as for bounds of another shape.
        """
        drawn = {}
        for name, draw in self.mapping.items():
            nominal = self._nominal[name]
            try:
                values = np.asarray(draw(random, nominal.copy()), nominal.dtype)
            except (TypeError, ValueError, OverflowError) as error:
                kind = TypeError if isinstance(error, TypeError) else ValueError
                raise kind(f"randomize[{name!r}], which is {draw!r}: {error}") from error
            is_of_shape = values.shape == nominal.shape
            if not (is_of_shape and np.isfinite(values).all()):
                drew = values if is_of_shape else f"an array of shape {values.shape}"
                raise ValueError(
                    f"randomize[{name!r}] drew {drew}; expected finite numbers of shape "
                    f"{nominal.shape}, that of the model's field"
                )
            drawn[name] = values
        return drawn


def show_drawn(
    shown: dict[str, np.ndarray],
    drawn: Mapping[str, np.ndarray],
    rows: np.ndarray | int,
    num_envs: int,
) -> None:
    """Write values drawn for rows into the arrays of a batch, (num_envs, ...) by field.

    Args:
      shown: the arrays, of which missing ones are added.
      drawn: the values by field: of one row, or with a leading axis of rows.
      rows: the number of the row, or the numbers of the rows.
      num_envs: number of rows of the batch.
    """
    for name, values in drawn.items():
        shape = num_envs, *values.shape[np.ndim(rows) :]
        shown.setdefault(name, np.zeros(shape, values.dtype))[rows] = values
