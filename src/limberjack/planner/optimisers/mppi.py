"""`MPPI`: the mean of all samples, weighted so that low costs count most.

    settings = Settings(optimiser=MPPI(temperature=0.1))

Williams et al., 2017, "Information theoretic MPC" (arXiv 1707.02342).
"""

import dataclasses

import numpy as np

from limberjack.planner.optimisers.base import Optimiser, Search

__all__ = ["MPPI"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class MPPI(Optimiser):
    """Model-predictive path integral control.

    Attributes:
      temperature: scale of the cost differences at which samples lose weight, as a fraction of the
        difference between the best sample and the first one beyond the best eighth.
    """

    temperature: float = 0.3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.temperature < np.inf:
            raise ValueError(f"temperature is {self.temperature!r}; expected a positive number")

    def new_plan(
        self, search: Search, samples: np.ndarray, costs: np.ndarray, iteration: int
    ) -> np.ndarray:
        """The samples' mean, where the best count most; the first if no cost is finite."""
        # The spread of the best eighth: bad proposals must not blur differences between good ones.
        rank = max(1, len(costs) // 8)
        best, beyond = costs.min(), np.partition(costs, rank)[rank]
        if not best < beyond < np.inf:
            return samples[int(np.argmin(costs))]
        weights = np.exp((best - costs) / (self.temperature * (beyond - best)))
        weights /= weights.sum()
        return (weights[:, None, None] * samples).sum(axis=0)
