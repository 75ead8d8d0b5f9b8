"""`load`: the episodes and transitions of a collected dataset, as arrays that are read on demand.

    dataset = load("data")
    for episode in dataset:                         # in the order of the seeds
        print(episode.seed, episode.total)
    for batch in dataset.batches(256, seed=0):      # shuffled; None for the recorded order
        learn(batch.observations["joint_angles"], batch.actions, batch.rewards)

Only footers are read at first, and then one file of up to 64 episodes at a time. A dataset may come
from anyone: nothing in it is executed, and a damaged file is an error that names it.
"""

import dataclasses
from collections.abc import Generator, Iterator, Mapping
from pathlib import Path

import numpy as np

from limberjack.episodes.episode import Episode
from limberjack.episodes.folder import shards_in
from limberjack.episodes.parquet import Shard
from limberjack.episodes.recipe import Recipe
from limberjack.rl.guards import at_least_one

__all__ = ["Batch", "Dataset", "load"]


@dataclasses.dataclass(frozen=True)
class Batch:
    """N transitions, in arrays that may be changed.

    Attributes:
      observations: before the step, by name, (N, ...).
      actions: (N, ...) float64.
      rewards: (N,) float64.
      next_observations: after the step, by name, (N, ...).
      terminated: whether the task ended the episode, (N,): nothing follows to bootstrap from.
      truncated: whether the time limit ended the episode, (N,).
    """

    observations: Mapping[str, np.ndarray]
    actions: np.ndarray
    rewards: np.ndarray
    next_observations: Mapping[str, np.ndarray]
    terminated: np.ndarray
    truncated: np.ndarray

    def __len__(self) -> int:
        return len(self.rewards)


def load(directory: Path | str) -> "Dataset":
    """The dataset in a folder.

    Raises:
      OSError: the folder or a file cannot be read.
      ValueError: there is no dataset, or a file is damaged or belongs to another one.
      ImportError: the extra `data` is missing.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise ValueError(f"{folder} is no folder; expected one that `limberjack collect` wrote")
    shards = shards_in(folder)
    if not shards:
        raise ValueError(
            f"{folder} has no complete file of a dataset; expected seeds-*.parquet, as `limberjack "
            "collect` writes them"
        )
    return Dataset(shards)


class Dataset:
    """Episodes in files, in the order of their seeds.

    Attributes:
      shards: the files.
      recipe: everything that the episodes depend on except for the seeds.
    """

    def __init__(self, shards: list[Shard]) -> None:
        """Takes at least one file; all have the same recipe and different seeds."""
        self.shards = shards
        self.recipe: Recipe = shards[0].recipe

    @property
    def seeds(self) -> list[int]:
        """The seeds of the episodes."""
        return [seed for shard in self.shards for seed in shard.seeds]

    @property
    def steps(self) -> int:
        """The steps of all episodes together."""
        return sum(sum(shard.lengths) for shard in self.shards)

    def __len__(self) -> int:
        """The number of episodes."""
        return sum(len(shard.seeds) for shard in self.shards)

    def __iter__(self) -> Iterator[Episode]:
        """The episodes, read one at a time into arrays that must not be changed."""
        for shard in self.shards:
            yield from shard.episodes()

    def episode(self, seed: int) -> Episode:
        """The episode of a seed.

        Raises:
          KeyError: there is no such episode.
          ValueError: its file is damaged.
        """
        for shard in self.shards:
            if seed in shard.seeds:
                with shard.opened() as read:
                    return read(seed)
        raise KeyError(f"no episode of seed {seed!r}; the first one has seed {self.seeds[0]}")

    def part(self, k: int, n: int) -> "Dataset":
        """Every n-th file from the k-th on, counted from 0: for a worker of a data loader.

        Raises:
          ValueError: that part has no file.
        """
        shards = self.shards[k::n] if 0 <= k < n else []
        if not shards:
            raise ValueError(f"there is no part {k} of {n} in {len(self.shards)} files")
        return Dataset(shards)

    def batches(self, size: int, *, seed: int | None = None) -> Iterator[Batch]:
        """All transitions once, in batches; the last one may be smaller.

        Args:
          size: transitions of a batch.
          seed: shuffles the files, and the transitions within each file of up to 64 episodes; None
            for the order of seeds and steps.

        Raises:
          ValueError: `size` is not a whole number of at least 1, or a file is damaged.
        """
        size = at_least_one("size", size)
        random = None if seed is None else np.random.default_rng(seed)
        order = range(len(self.shards)) if random is None else random.permutation(len(self.shards))
        left: list[Batch] = []
        for number in order:
            left = yield from _batches(_Rows(self.shards[number]), size, random, left)
        if left:
            yield _joined(left)


class _Rows:
    """The rows of a file: of each episode one per step, and one for its last observation."""

    def __init__(self, shard: Shard) -> None:
        episodes = list(shard.episodes())
        of_names = {
            name: [e.observations[name] for e in episodes] for name in episodes[0].observations
        }
        self._observations = {name: np.concatenate(parts) for name, parts in of_names.items()}
        self._actions, self._rewards, self._terminated, self._truncated = (
            np.concatenate([getattr(e, name) for e in episodes])
            for name in ("actions", "rewards", "terminated", "truncated")
        )
        lengths = np.array([episode.length for episode in episodes])
        # The row of a step: those of all steps before it, and a last one of each earlier episode.
        self._row = np.arange(lengths.sum()) + np.repeat(np.arange(len(lengths)), lengths)

    def __len__(self) -> int:
        return len(self._row)

    def batch(self, steps: np.ndarray) -> Batch:
        """The transitions of some steps."""
        rows = self._row[steps]
        return Batch(
            {name: values[rows] for name, values in self._observations.items()},
            self._actions[steps],
            self._rewards[steps],
            {name: values[rows + 1] for name, values in self._observations.items()},
            self._terminated[steps],
            self._truncated[steps],
        )


def _batches(
    rows: _Rows, size: int, random: np.random.Generator | None, left: list[Batch]
) -> Generator[Batch, None, list[Batch]]:
    """Batches of a file's transitions, after what was left of the one before; returns the rest."""
    steps = np.arange(len(rows)) if random is None else random.permutation(len(rows))
    first = size - sum(map(len, left)) if left else 0
    if first > len(steps):
        return [*left, rows.batch(steps)]
    if left:
        yield _joined([*left, rows.batch(steps[:first])])
    whole = first + (len(steps) - first) // size * size
    for begin in range(first, whole, size):
        yield rows.batch(steps[begin : begin + size])
    return [rows.batch(steps[whole:])] if whole < len(steps) else []


def _joined(parts: list[Batch]) -> Batch:
    def together(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts])

    def observed(name: str) -> dict[str, np.ndarray]:
        of_parts = [getattr(part, name) for part in parts]
        return {key: np.concatenate([one[key] for one in of_parts]) for key in of_parts[0]}

    return Batch(
        observed("observations"),
        together("actions"),
        together("rewards"),
        observed("next_observations"),
        together("terminated"),
        together("truncated"),
    )
