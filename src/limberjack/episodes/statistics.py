"""Statistics over episodes: mean return with a confidence interval, median, success rate.

    summary = summarise(scores)
    print(summary.mean, summary.interval, summary.success_rate)
    by_start = strata(scores)           # the same for each kind of start

An episode counts as a success if the mean reward of its last 100 steps is at least 0.9: the goal
was reached and held. Results are reproducible: the bootstrap has a fixed seed.
"""

import collections
import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from limberjack.episodes.episode import Episode

__all__ = [
    "CONFIDENCE",
    "LAST_STEPS",
    "RESAMPLES",
    "SUCCESS_REWARD",
    "Score",
    "Summary",
    "bootstrap_interval",
    "bootstrapped",
    "strata",
    "summarise",
]

LAST_STEPS = 100  # final steps of an episode that decide on success; a tenth of a suite episode
SUCCESS_REWARD = 0.9  # mean reward of those steps that counts as success; the maximum is 1
CONFIDENCE = 0.95  # level of the interval of the mean
RESAMPLES = 10_000  # of the bootstrap, so that each tail of 2.5 % holds 250 of them

_BOOTSTRAP_SEED = 0
_CHUNK = 1_000_000  # numbers drawn at once; they take 8 MB


@dataclasses.dataclass(frozen=True)
class Score:
    """Result of one episode."""

    seed: int
    total: float  # the return
    length: int  # steps
    final_reward: float  # the mean of the last 100 steps' rewards; 0 if the simulation diverged
    diverged: bool = False
    start: str | None = None  # the kind of start; None if the task has no kinds
    processor: str | None = None  # that played it; None unless processors may differ

    @classmethod
    def of(cls, episode: Episode, processor: str | None = None) -> "Score":
        """The score of an episode; one whose simulation diverged is never a success.

        Args:
          episode: if it is shorter than 100 steps, all of them count for success.
          processor: that played it, if the score is to name it.
        """
        with np.errstate(all="ignore"):  # a user's task may give any number
            final = 0.0 if episode.diverged else float(np.mean(episode.rewards[-LAST_STEPS:]))
        return cls(
            episode.seed,
            episode.total,
            episode.length,
            final,
            episode.diverged,
            episode.start,
            processor,
        )

    @property
    def success(self) -> bool:
        """Whether the mean reward of the last 100 steps is at least 0.9."""
        return self.final_reward >= SUCCESS_REWARD


@dataclasses.dataclass(frozen=True)
class Summary:
    """Statistics of several episodes."""

    episodes: int
    mean: float  # of the returns
    interval: tuple[float, float] | None  # 95 % of the mean; None for fewer than two episodes
    median: float  # of the returns
    successes: int
    diverged: int  # episodes that ended because their simulation diverged

    @property
    def success_rate(self) -> float:
        """The share of episodes that succeeded."""
        return self.successes / self.episodes

    def as_json(self) -> dict[str, object]:
        """The numbers by name, as result.json has them; None for those that are not finite."""
        numbers = {**dataclasses.asdict(self), "success_rate": self.success_rate}
        return {name: _as_json(value) for name, value in numbers.items()}


def _as_json(value: object) -> object:
    """A number, or several, as values of JSON, which has no NaN."""
    if isinstance(value, tuple):
        return tuple(map(_as_json, value))
    return None if isinstance(value, float) and not math.isfinite(value) else value


def summarise(scores: Sequence[Score]) -> Summary:
    """The summary of at least one episode."""
    returns = np.array([score.total for score in scores])
    with np.errstate(all="ignore"):  # of returns that are not finite, or sum up to none
        mean, median = float(np.mean(returns)), float(np.median(returns))
    return Summary(
        episodes=len(scores),
        mean=mean,
        interval=bootstrap_interval(returns),
        median=median,
        successes=sum(score.success for score in scores),
        diverged=sum(score.diverged for score in scores),
    )


def strata(scores: Iterable[Score]) -> dict[str, Summary]:
    """The summary of each kind of start that occurs, by name; empty where there are no kinds."""
    by_start: dict[str, list[Score]] = collections.defaultdict(list)
    for score in scores:
        if score.start is not None:
            by_start[score.start].append(score)
    return {start: summarise(by_start[start]) for start in sorted(by_start)}


def bootstrap_interval(values: np.ndarray) -> tuple[float, float] | None:
    """The 95 % confidence interval of the mean, by the percentile bootstrap.

    It draws 10,000 resamples of N values with replacement, and returns the 2.5 % and the 97.5 %
    quantile of their means. The same values in the same order give the same bounds.

    Args:
      values: (N,).

    Returns:
      The bounds; None for fewer than two values, which have no spread.
    """
    count = len(values)
    if count < 2:
        return None

    def means(stream: np.random.RandomState, resamples: int) -> np.ndarray:
        return values[stream.randint(count, size=(resamples, count))].mean(axis=-1)

    return bootstrapped(means, count, RESAMPLES)


def bootstrapped(
    draw: Callable[[np.random.RandomState, int], np.ndarray], size: int, resamples: int
) -> tuple[float, float]:
    """The 2.5 % and the 97.5 % quantile of a statistic of resamples.

    Args:
      draw: takes a stream and a number of resamples, and returns the statistic of each, (n,).
      size: numbers in a resample.
      resamples: their number.
    """
    # RandomState: its streams are the same in all versions of NumPy.
    stream = np.random.RandomState(_BOOTSTRAP_SEED)
    at_once = max(1, _CHUNK // size)
    tail = (1 - CONFIDENCE) / 2
    with np.errstate(all="ignore"):  # of returns that are not finite, or sum up to none
        found = [
            draw(stream, min(at_once, resamples - first)) for first in range(0, resamples, at_once)
        ]
        low, high = np.quantile(np.concatenate(found), [tail, 1 - tail])
    return float(low), float(high)
