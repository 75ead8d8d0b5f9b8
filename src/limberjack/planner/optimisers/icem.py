"""`ICEM`: the cross-entropy method with smooth samples and a memory of good ones.

    settings = Settings(optimiser=ICEM(iterations=2, colour=2.0))

Each iteration moves mean and deviation of the samples to those of its elites, the samples of least
cost. Some elites are tried again in the next iteration, and, shifted in time, in the next planning
step. Pinneri et al., 2020, "Sample-efficient cross-entropy method for real-time planning" (arXiv
2008.06389), with equal numbers of samples in all iterations, which one batch serves.
"""

import dataclasses

import numpy as np

from limberjack.planner.optimisers.base import Optimiser, Search

__all__ = ["ICEM"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ICEM(Optimiser):
    """Improved cross-entropy method.

    Attributes:
      elites: share of an iteration's samples from which mean and deviation follow.
      kept: share of the elites that are tried again, before the proposals.
      momentum: share of the old mean and deviation in the new ones.
      takes_best: whether the new plan is the best sample of the last iteration, not the mean.
    """

    iterations: int = 2
    colour: float = 2.0
    finest: float = 1.0
    elites: float = 0.15
    kept: float = 0.3
    momentum: float = 0.1
    takes_best: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, most in (("elites", 0.5), ("kept", 1.0), ("momentum", 1.0)):
            share = getattr(self, name)
            if not 0 <= share <= most:
                raise ValueError(f"{name} is {share!r}; expected a share from 0 to {most:g}")

    def known(self, search: Search, iteration: int) -> np.ndarray:
        """The elites of before, then the proposals."""
        proposals = super().known(search, iteration)
        if not len(search.elites):
            return proposals
        return np.concatenate([search.elites, proposals])

    def new_plan(
        self, search: Search, samples: np.ndarray, costs: np.ndarray, iteration: int
    ) -> np.ndarray:
        """The elites' mean, or the best of them; the first sample if no cost is finite."""
        finite = int(np.isfinite(costs).sum())
        if not finite:
            search.elites = samples[:0]
            return samples[0]
        count = min(max(2, round(self.elites * len(samples))), finite)
        elites = samples[np.argsort(costs, kind="stable")[:count]]
        search.elites = elites[: round(self.kept * count)]
        is_last = iteration == self.iterations - 1
        unit = search.noise * search.scale
        deviation = elites.std(axis=0) / np.where(unit == 0, 1.0, unit)
        before = np.ones(()) if iteration == 0 else search.deviation
        # The next planning step begins with all of the noise.
        spread = self.momentum * before + (1.0 - self.momentum) * deviation
        search.deviation = np.ones(()) if is_last else spread
        if is_last and self.takes_best:
            return elites[0]
        return self.momentum * search.current + (1.0 - self.momentum) * elites.mean(axis=0)
