"""`Figures`: returns, and the mean, deviation, least and greatest of each number of episodes.

    figures = Figures(recipe)
    for episode in episodes:            # in the order of their seeds: equal episodes, equal bits
        figures.add(episode)
    text = figures.text()               # for the footer of a file
    figures.include(Figures.parse(text, recipe, episodes=140))     # of the file that follows

Sums are made in order, one number after the other, so that neither the processor nor the parts in
which episodes are played change a bit. Observations count with the last one of an episode.
"""

import json
from collections.abc import Mapping, Sequence

import numpy as np

from limberjack.episodes.episode import Episode
from limberjack.episodes.recipe import OBSERVATION, Recipe

__all__ = ["Figures", "values_of"]

_NAMES = ("mean", "squares", "min", "max")  # squares: sums of squared deviations from the mean


class Figures:
    """Statistics of columns with `has_figures`; `returns` has one number per episode."""

    def __init__(self, recipe: Recipe) -> None:
        """Has no episode yet."""
        self.returns: list[float] = []
        self._sizes = {c.name: c.size for c in recipe.columns if c.has_figures}
        self._counts = dict.fromkeys(self._sizes, 0)  # rows
        self._of: dict[str, dict[str, np.ndarray]] = {}

    def add(self, episode: Episode) -> None:
        """Counts an episode in, whose seed is greater than those before."""
        self.returns.append(episode.total)
        for name, size in self._sizes.items():
            values = values_of(episode, name)
            values = np.asarray(values, float).reshape(len(values), size)
            with np.errstate(all="ignore"):  # a simulation that diverges may give any number
                mean = np.cumsum(values, axis=0)[-1] / len(values)
                squares = np.cumsum((values - mean) ** 2, axis=0)[-1]
            found = (mean, squares, values.min(axis=0), values.max(axis=0))
            self._merge(name, len(values), dict(zip(_NAMES, found, strict=True)))

    def include(self, other: "Figures") -> None:
        """Counts the episodes of other figures in, whose seeds are greater."""
        self.returns += other.returns
        for name, count in other._counts.items():
            self._merge(name, count, other._of[name])

    def _merge(self, name: str, count: int, of: Mapping[str, np.ndarray]) -> None:
        before, ours = self._counts[name], self._of.get(name)
        self._counts[name] = total = before + count
        if ours is None:
            self._of[name] = dict(of)
            return
        with np.errstate(all="ignore"):
            gap = of["mean"] - ours["mean"]
            self._of[name] = {
                "mean": ours["mean"] + gap * (count / total),
                "squares": ours["squares"] + of["squares"] + gap * gap * (before * count / total),
                "min": np.minimum(ours["min"], of["min"]),
                "max": np.maximum(ours["max"], of["max"]),
            }

    def statistics(self) -> dict[str, dict[str, list[float | None]]]:
        """The figures of each column, in the order of an array's numbers; null for no number."""
        found = {}
        for name, of in self._of.items():
            with np.errstate(all="ignore"):
                deviation = np.sqrt(of["squares"] / self._counts[name])
            shown = {"mean": of["mean"], "std": deviation, "min": of["min"], "max": of["max"]}
            found[name] = {key: _listed(values) for key, values in shown.items()}
        return found

    def returns_listed(self) -> list[float | None]:
        """The returns as values of JSON."""
        return _listed(np.array(self.returns))

    def text(self) -> str:
        """The figures as JSON; equal figures give equal texts."""
        of = {
            name: {"count": self._counts[name], **{key: _listed(v) for key, v in one.items()}}
            for name, one in self._of.items()
        }
        content = {"returns": self.returns_listed(), "columns": of}
        return json.dumps(content, sort_keys=True, separators=(",", ":"))

    @classmethod
    def parse(cls, text: str | bytes, recipe: Recipe, episodes: int) -> "Figures":
        """The figures of so many episodes in a footer.

        Raises:
          ValueError: it is no such text.
        """
        figures = cls(recipe)
        try:
            content = json.loads(text)
            figures.returns = _numbers(content["returns"], episodes).tolist()
            for name, size in figures._sizes.items():
                one = content["columns"][name]
                figures._counts[name] = int(one["count"])
                figures._of[name] = {key: _numbers(one[key], size) for key in _NAMES}
        except (KeyError, OverflowError, RecursionError, TypeError, ValueError) as error:
            raise ValueError(f"its figures are damaged: {error}") from error
        if not all(0 < count < 2**63 for count in figures._counts.values()):
            raise ValueError(f"its figures are of {figures._counts} rows")
        return figures


def values_of(episode: Episode, name: str) -> np.ndarray:
    """The values of a column: an observation, the actions or the rewards, (steps, ...)."""
    if name.startswith(OBSERVATION):
        return episode.observations[name.removeprefix(OBSERVATION)]
    return episode.actions if name == "action" else episode.rewards


def _listed(values: np.ndarray) -> list[float | None]:
    """The numbers as values of JSON, which has no NaN."""
    return [value if np.isfinite(value) else None for value in values.tolist()]


def _numbers(entry: Sequence[float | None], size: int) -> np.ndarray:
    numbers = np.array([np.nan if value is None else value for value in entry], float)
    if numbers.shape != (size,):
        raise ValueError(f"{len(numbers)} numbers; expected {size}")
    return numbers
