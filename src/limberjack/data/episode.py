"""`Episode`: every step of one episode, in arrays.

episode = dataset.episode(seed=3)
episode.observations["joint_angles"][t]     # before step t; one more after the last step
episode.actions[t], episode.rewards[t]      # of step t
"""

import dataclasses
from collections.abc import Mapping

import numpy as np

__all__ = ["Episode"]


@dataclasses.dataclass(frozen=True)
class Episode:
    """The first episode of an environment with some seed, of T steps.

    Attributes:
      seed: of the environment.
      start: the kind of start; None if the task has no kinds.
      observations: before each step and after the last one, by name, (T + 1, ...).
      actions: (T, ...) float64, as the policy returned them.
      rewards: (T,) float64.
      terminated: whether the task ended the episode with this step, (T,).
      truncated: whether the time limit ended the episode with this step, (T,).
      success: whether the goal is reached after each step, (T,); None for a task without a goal.
      diverged: whether the episode ended because its simulation diverged.
      states: MuJoCo's integration states, (T + 1, nstate); None if they were not recorded.
      fields: the model fields that were drawn for the episode, by name.
    """

    seed: int
    start: str | None
    observations: Mapping[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    success: np.ndarray | None = None
    diverged: bool = False
    states: np.ndarray | None = None
    fields: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)

    @property
    def length(self) -> int:
        """The number of steps."""
        return len(self.rewards)

    @property
    def total(self) -> float:
        """The return: the rewards, added in order."""
        return float(np.cumsum(self.rewards)[-1])
