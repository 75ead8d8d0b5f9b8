"""Domain randomisation: fields of the model drawn anew at the start of each episode.

    randomize = {"geom_friction": scale(0.7, 1.3), "opt.gravity": shift([-1, 0, 0], [1, 0, 0])}
    env = suite.load("humanoid", "walk", environment_kwargs={"randomize": randomize})
    env.reset()
    env.randomization["geom_friction"]     # what was drawn

A mapping names fields of `mujoco.MjModel` (those of its options as 'opt.gravity') and how each is
drawn: by `scale`, `shift`, or a function of a `RandomState` and the model's own values that returns
values of the same shape. The draws come from a stream beside the one that starts are drawn from,
so the starts stay those without randomisation; a row of a batch draws what the single environment
with its seed draws.
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
    """Values times a factor drawn uniformly for each object, such as each geom."""

    lower: float
    upper: float

    def __call__(self, random: np.random.RandomState, nominal: np.ndarray) -> np.ndarray:
        # One number for each row, which broadcasts over the row's columns.
        shape = nominal.shape[:1] + (1,) * (nominal.ndim - 1)
        return nominal * random.uniform(self.lower, self.upper, shape)


@dataclasses.dataclass(frozen=True)
class shift:  # noqa: N801
    """Values plus an amount drawn uniformly for each number; the bounds broadcast."""

    lower: float | Sequence[float] | np.ndarray
    upper: float | Sequence[float] | np.ndarray

    def __call__(self, random: np.random.RandomState, nominal: np.ndarray) -> np.ndarray:
        return nominal + random.uniform(self.lower, self.upper, nominal.shape)


def stream_beside(random: np.random.RandomState) -> np.random.RandomState:
    """A stream that follows from the present state of another, which does not notice."""
    _, key, position, *_ = random.get_state(legacy=True)
    return np.random.RandomState(np.append(np.asarray(key, np.uint32), np.uint32(position)))


class Randomizer:
    """A mapping of draws, checked against a model."""

    def __init__(self, mapping: Mapping[str, Draw], physics: SimulatedPhysics) -> None:
        """Takes the model's present values as those that are varied.

        Raises:
          ValueError: the model has no such field, or it is part of the model's structure.
          TypeError: it is no mapping, or a draw is not a function.
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
          ValueError: a draw gave another shape, or something not finite.
        """
        drawn = {}
        for name, draw in self.mapping.items():
            nominal = self._nominal[name]
            values = np.asarray(draw(random, nominal.copy()), nominal.dtype)
            if values.shape != nominal.shape or not np.isfinite(values).all():
                raise ValueError(
                    f"randomize[{name!r}] drew an array of shape {values.shape}; expected finite "
                    f"numbers of shape {nominal.shape}, that of the model's field"
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
