"""`Statistics`: mean, deviation, range and quantiles of each number of observations and actions.

    statistics = statistics_of(files, recipe, lengths)  # one pass over the episodes of the files
    statistics.observations["velocity"].mean        # in the shape of a velocity
    statistics.actions.quantiles[0.99]

Mean, deviation, least and greatest value are computed by `figures.Figures`, as those in
dataset.json are: of a whole dataset they have the same bits.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from limberjack.episodes.episode import Episode
from limberjack.episodes.figures import Figures, values_of
from limberjack.episodes.recipe import OBSERVATION, Column, Recipe

__all__ = ["QUANTILES", "Spread", "Statistics", "statistics_of"]

QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)

# Rows whose numbers are kept for the quantiles: of a humanoid's observations, 70 MB. Their error is
# a twentieth of a percentile in the middle: sqrt(0.25 / rows) is 0.0014.
_MOST_ROWS = 2**17


@dataclasses.dataclass(frozen=True)
class Spread:
    """Statistics of the values of a column; each has the shape of a value, and is float64.

    Attributes:
      count: values.
      mean: of them.
      std: their standard deviation, divided by their number.
      min: the least one.
      max: the greatest one.
      quantiles: by probability, those of `QUANTILES`, interpolated linearly. Of more than 131,072
        values, they are those of as many, chosen at random, always the same ones.
    """

    count: int
    mean: np.ndarray
    std: np.ndarray
    min: np.ndarray
    max: np.ndarray
    quantiles: Mapping[float, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Statistics:
    """The spreads of the columns of a dataset.

    Attributes:
      observations: by name; the last one of an episode counts.
      actions: of all steps.
      rewards: of all steps.
    """

    observations: Mapping[str, Spread]
    actions: Spread
    rewards: Spread


class _Sample:
    """The values of a column that the quantiles are of."""

    def __init__(self, count: int) -> None:
        """Chooses rows, of so many."""
        self._rows: np.ndarray | None = None  # all
        if count > _MOST_ROWS:
            chosen = np.random.default_rng(0).choice(count, _MOST_ROWS, replace=False)
            self._rows = np.sort(chosen)
        self._seen = 0
        self._parts: list[np.ndarray] = []

    def add(self, values: np.ndarray) -> None:
        """Takes those of an episode that are chosen."""
        first, self._seen = self._seen, self._seen + len(values)
        if self._rows is None:
            self._parts.append(values)
            return
        begin, end = np.searchsorted(self._rows, (first, self._seen))
        self._parts.append(values[self._rows[begin:end] - first])

    def quantiles(self) -> dict[float, np.ndarray]:
        """By probability."""
        values = np.concatenate(self._parts).astype(float)
        with np.errstate(all="ignore"):  # a simulation that diverges may give any number
            found = np.quantile(values, QUANTILES, axis=0)
        return dict(zip(QUANTILES, found, strict=True))


def statistics_of(
    files: Iterable[Iterable[Episode]], recipe: Recipe, lengths: Sequence[int]
) -> Statistics:
    """The statistics of the columns of a recipe; the episodes are in memory one at a time.

    Args:
      files: with the episodes of each.
      recipe: its columns are those of the episodes.
      lengths: steps of each episode.
    """
    columns = [column for column in recipe.columns if column.has_figures]
    steps = sum(lengths)
    counts = {c.name: steps if c.is_of_step else steps + len(lengths) for c in columns}
    samples = {name: _Sample(count) for name, count in counts.items()}
    figures = Figures(recipe)
    for episodes in files:
        of_file = Figures(recipe)
        for episode in episodes:
            of_file.add(episode)
            for name, sample in samples.items():
                sample.add(values_of(episode, name))
        figures.include(of_file)  # in the order of sums of dataset.json
    moments = figures.statistics()
    spreads = {
        c.name: _spread(c, counts[c.name], moments[c.name], samples[c.name].quantiles())
        for c in columns
    }
    observations = {
        name.removeprefix(OBSERVATION): spread
        for name, spread in spreads.items()
        if name.startswith(OBSERVATION)
    }
    return Statistics(observations, spreads["action"], spreads["reward"])


def _spread(
    column: Column,
    count: int,
    moments: Mapping[str, list[float | None]],
    quantiles: Mapping[float, np.ndarray],
) -> Spread:
    def shaped(name: str) -> np.ndarray:
        numbers = [np.nan if value is None else value for value in moments[name]]
        return np.array(numbers).reshape(column.shape)

    return Spread(count, shaped("mean"), shaped("std"), shaped("min"), shaped("max"), quantiles)
