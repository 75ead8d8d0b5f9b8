"""`Episode`: an episode that has ended, with what was kept of its steps (`Kept`).

episode.rewards[t]                          # of step t
episode.actions[t]                          # the same; empty unless steps were kept
episode.observations["joint_angles"][t]     # before step t; one more after the last step
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

from limberjack.rl.pixels import Pixels

__all__ = ["Episode", "Kept"]


@dataclasses.dataclass(frozen=True)
class Kept:
    """The parts of an episode that are kept besides its rewards and actions.

    Attributes:
      states: MuJoCo's integration state as well.
      float32: observations as float32; actions, rewards and states always are float64.
      flat: the observations joined into one array.
      pixels: a picture before each step and after the last one, among the observations and in an
        array of its own; None for no pictures. The policy does not see it.
    """

    states: bool = False
    float32: bool = False
    flat: bool = False
    pixels: Pixels | None = None

    def __post_init__(self) -> None:
        """Raises ValueError for pictures that no row can have."""
        if self.pixels is not None and (
            self.pixels.only or self.pixels.frame_stack > 1 or isinstance(self.pixels.camera, tuple)
        ):
            raise ValueError(
                f"pixels is {self.pixels}; expected one camera, frame_stack 1 and only=False: "
                "windows of a dataset have the pictures before, and select(['pixels']) only them"
            )

    def as_json(self) -> dict[str, object]:
        """The attributes as values of JSON by name, without `pixels` if there are none."""
        kept = dataclasses.asdict(self)
        if self.pixels is None:
            del kept["pixels"]
        return kept

    def observed_type(self, dtype: np.dtype) -> np.dtype:
        """The type in which observations of a type are kept."""
        return np.dtype(np.float32) if self.float32 and dtype == np.float64 else dtype


def _none() -> np.ndarray:
    return np.zeros(0)


@dataclasses.dataclass(frozen=True)
class Episode:
    """The first episode of an environment with some seed, of T steps.

    Attributes:
      seed: of the environment.
      start: the kind of start; None if the task has no kinds.
      rewards: (T,) float64.
      diverged: whether the episode ended because its simulation diverged.
      actions: (T, ...) float64, as the policy returned them. These and the following attributes are
        empty or None unless steps were kept.
      terminated: whether the task ended the episode with this step, (T,).
      truncated: whether the time limit ended the episode with this step, (T,).
      success: whether the goal is reached after each step, (T,); None for a task without a goal.
      observations: before each step and after the last one, by name, (T + 1, ...). After a step
        that diverged, the one before it.
      states: MuJoCo's integration states, (T + 1, nstate), likewise; None if they were not kept.
      fields: the model fields that were drawn for the episode, by name.
    """

    seed: int
    start: str | None
    rewards: np.ndarray
    diverged: bool = False
    actions: np.ndarray = dataclasses.field(default_factory=_none)
    terminated: np.ndarray = dataclasses.field(default_factory=_none)
    truncated: np.ndarray = dataclasses.field(default_factory=_none)
    success: np.ndarray | None = None
    observations: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    states: np.ndarray | None = None
    fields: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)

    @property
    def length(self) -> int:
        """The number of steps."""
        return len(self.rewards)

    @property
    def returns(self) -> np.ndarray:
        """The rewards summed up to each step, (T,), added in order as a loop would."""
        with np.errstate(all="ignore"):  # a user's task may give any number
            return np.cumsum(self.rewards)

    @property
    def total(self) -> float:
        """The episode's return: the sum of its rewards."""
        return float(self.returns[-1]) if self.length else 0.0
