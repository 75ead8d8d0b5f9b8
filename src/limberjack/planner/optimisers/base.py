"""`Optimiser`: the way from a plan to a better one, by the costs of sampled plans.

    search = Search(current, proposals, elites, scale, noise, within_limits, random)
    plan = MPPI().optimise(search, 64, costs_of)

An optimiser has three verbs. `samples` draws plans, the function `costs_of` rolls them out, and
`new_plan` is the plan that follows from their costs. It repeats them `iterations` times. It knows
nothing of tasks, and keeps nothing: what lasts from one planning step to the next is in the
`Search`, so that optimisers are constants that `Settings` may share.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

__all__ = ["CostsOf", "Optimiser", "Search", "coloured_noise"]

# From plans, (n, knots, nu), to their costs, (n,); infinite where a plan cannot be used.
CostsOf = Callable[[np.ndarray], np.ndarray]


@dataclasses.dataclass
class Search:
    """The problem of one planning step.

    Attributes:
      current: the plan to improve, (knots, nu).
      proposals: plans to try as they are in the first iteration, (n, knots, nu), within limits.
      elites: good plans of the last iteration, also of the last planning step, shifted in time.
      scale: units of the noise of each target, (nu,).
      noise: largest standard deviation of targets, in these units.
      within_limits: brings targets, (..., nu), into their ranges.
      random: the stream of samples.
      deviation: standard deviation of each target, (knots, nu), in units of the noise.
    """

    current: np.ndarray
    proposals: np.ndarray
    elites: np.ndarray
    scale: np.ndarray
    noise: float
    within_limits: Callable[[np.ndarray], np.ndarray]
    random: np.random.Generator
    deviation: np.ndarray = dataclasses.field(default_factory=lambda: np.ones(()))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Optimiser:
    """Variations of the current plan; a subclass says what follows from their costs.

    Attributes:
      iterations: rounds of samples in a planning step, which share the settings' samples.
      colour: exponent of the noise along a plan: the power of a frequency f is f to its negative.
        0 is white; with 2 neighbouring knots move together, so that samples are smooth.
      finest: the smallest noise of a sample, as a fraction of the largest. Each sample draws its
        own from the log-uniform distribution: large ones find another path, small ones bring the
        last millimetre. 1 gives all the same.
    """

    iterations: int = 1
    colour: float = 0.0
    finest: float = 0.03

    def __post_init__(self) -> None:
        if not isinstance(self.iterations, int) or self.iterations < 1:
            raise ValueError(f"iterations is {self.iterations!r}; expected a whole number from 1")
        if not 0 < self.finest <= 1:
            raise ValueError(f"finest is {self.finest!r}; expected a fraction from above 0 up to 1")
        if not 0 <= self.colour < np.inf:
            raise ValueError(f"colour is {self.colour!r}; expected a number from 0 up")

    def optimise(self, search: Search, samples: int, costs_of: CostsOf) -> np.ndarray:
        """The new plan, (knots, nu), from as many samples in all; at least 2 in an iteration."""
        for iteration in range(self.iterations):
            tried = self.samples(search, max(2, samples // self.iterations), iteration)
            search.current = self.new_plan(search, tried, costs_of(tried), iteration)
        return search.current

    def samples(self, search: Search, count: int, iteration: int) -> np.ndarray:
        """Plans to try, (count, knots, nu): the current one, known ones, and variations of it."""
        known = self.known(search, iteration)[: count // 2]
        samples = np.repeat(search.current[None], count, axis=0)
        taken, varied = np.split(samples[1:], [len(known)])
        taken[:] = known
        scales = np.exp(search.random.uniform(np.log(self.finest), 0.0, len(varied)))
        scales *= search.noise
        noise = coloured_noise(search.random, varied.shape, self.colour)
        varied += scales[:, None, None] * search.scale * noise * search.deviation
        samples[1:] = search.within_limits(samples[1:])
        return samples

    def known(self, search: Search, iteration: int) -> np.ndarray:
        """Plans that are tried as they are, (n, knots, nu), the most important ones first.

        No more of them are tried than fill half of the samples.
        """
        return search.proposals if iteration == 0 else search.proposals[:0]

    def new_plan(
        self, search: Search, samples: np.ndarray, costs: np.ndarray, iteration: int
    ) -> np.ndarray:
        """The plan that follows from the samples' costs, (knots, nu)."""
        raise NotImplementedError


def coloured_noise(
    random: np.random.Generator, shape: tuple[int, ...], exponent: float
) -> np.ndarray:
    """Normal noise of variance 1, (n, knots, nu), whose power along the knots falls with frequency.

    A longer noise is drawn and cut, since one that is made of whole waves would end as it begins.
    """
    noise = random.standard_normal(shape)
    if exponent == 0:
        return noise
    noise = np.concatenate([noise, random.standard_normal(shape)], axis=1)
    waves = np.arange(1, noise.shape[1] // 2 + 1)
    power = np.concatenate([[1.0], waves ** -float(exponent)])  # a constant as strong as one wave
    # How often each frequency occurs among those of a whole, complex transform.
    times = np.full(len(power), 2.0)
    times[0] = times[-1] = 1.0
    gain = np.sqrt(power / ((power * times).sum() / noise.shape[1]))
    spectrum = np.fft.rfft(noise, axis=1) * gain[:, None]
    return np.fft.irfft(spectrum, noise.shape[1], axis=1)[:, : shape[1]]
