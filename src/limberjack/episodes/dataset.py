"""`load`: the episodes and transitions of a collected dataset, as arrays that are read on demand.

    dataset = load("data")                          # every file that its manifest lists is there
    for episode in dataset:                         # in the order of the seeds
        print(episode.seed, episode.total)
    for batch in dataset.batches(256, seed=0):      # shuffled; None for the recorded order
        learn(batch.observations["joint_angles"], batch.actions, batch.rewards)
    information = inform(dataset, verify=True)      # returns, sizes, hashes

Only the manifest and footers are read at first, and then one file of episodes at a time. A dataset
may come from anyone: nothing in it is executed, and a damaged file is an error that names it.
"""

import dataclasses
import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from limberjack.episodes.episode import Episode
from limberjack.episodes.folder import calls_in, check_distinct
from limberjack.episodes.manifest import (
    EPISODES,
    MANIFEST,
    File,
    Manifest,
    sha256_of,
    united,
    without,
)
from limberjack.episodes.parquet import Shard
from limberjack.episodes.recipe import Recipe
from limberjack.episodes.statistics import Score, Summary, strata, summarise
from limberjack.rl.guards import at_least_one

__all__ = ["Batch", "Dataset", "Information", "inform", "load"]

_LONGEST = 1000  # characters of a command that is repeated in a message


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


def load(directory: Path | str, *, allow_gaps: bool = False) -> "Dataset":
    """The dataset in a folder.

    Args:
      directory: of the dataset, of this format or of format 1.
      allow_gaps: load the files that are there and are those of the manifest, or all if there is
        no manifest yet; `Dataset.gaps` lists the seeds that are missing.

    Raises:
      OSError: the folder or a file cannot be read.
      ValueError: there is no dataset, a file is damaged or belongs to another one, or two files
        have an episode of one seed. Without `allow_gaps`, a file is missing, is not listed in the
        manifest, or has another size, or there is no manifest.
      ImportError: the extra `data` is missing.
    """
    folder = Path(directory)
    if not folder.is_dir():
        raise ValueError(f"{folder} is no folder; expected one that `limberjack collect` wrote")
    manifest = Manifest.read(folder / MANIFEST)
    if manifest is not None:
        return _listed(folder, manifest, allow_gaps)
    old = [Shard(path) for path in sorted(folder.glob("seeds-*.parquet"))]
    shards = old or [Shard(path) for path in sorted((folder / EPISODES).glob("*.parquet"))]
    if not shards:
        raise ValueError(
            f"{folder} has no complete file of a dataset; expected {EPISODES}/seeds-*.parquet, as "
            "`limberjack collect` writes them"
        )
    check_distinct(shards)
    if not old and not allow_gaps:
        raise ValueError(
            f"{folder} has no {MANIFEST} yet: to finish the dataset, repeat {_command(folder)}; "
            "load(..., allow_gaps=True) gives the episodes that are there"
        )
    for shard in shards:
        if (shard.recipe.format == 1) is not bool(old):
            raise ValueError(f"{shard.path} has format {shard.recipe.format}, unlike its folder")
    return Dataset(shards)


def _listed(folder: Path, manifest: Manifest, allow_gaps: bool) -> "Dataset":
    """The dataset of a manifest, with which its files are compared."""
    shards: list[Shard] = []
    for file in manifest.files:
        path = folder / EPISODES / file.name
        wrong = _difference(path, file)
        if wrong is None:
            shards.append(_checked(path, file, manifest.recipe))
        elif not allow_gaps:
            raise ValueError(
                f"{wrong}: remove it if it is there, and repeat {_command(folder)}; "
                "load(..., allow_gaps=True) does without it"
            )
    names = {file.name for file in manifest.files}
    extra = sorted(p for p in (folder / EPISODES).glob("*") if p.name not in names)
    if extra and not allow_gaps:
        raise ValueError(
            f"{extra[0]} is not listed in {MANIFEST}: `limberjack collect` has not finished, and "
            f"{_command(folder)} continues it, or the file does not belong here; "
            "load(..., allow_gaps=True) loads it, too, if it has episodes"
        )
    shards += [Shard(path) for path in extra if path.suffix == ".parquet"]
    shards.sort(key=lambda shard: shard.seeds.start)
    check_distinct(shards)
    gaps = without(manifest.wanted, united(shard.seeds for shard in shards))
    if gaps and not allow_gaps:
        raise ValueError(
            f"{folder / MANIFEST} lists no file with the episode of seed {gaps[0].start}: repeat "
            f"{_command(folder)}; load(..., allow_gaps=True) does without it"
        )
    if not shards:
        raise ValueError(f"{folder} has none of the files that its {MANIFEST} lists")
    return Dataset(shards, files=manifest.files, gaps=gaps)


def _difference(path: Path, file: File) -> str | None:
    """A sentence on the size of a file that is not the listed one."""
    if not path.exists():
        return f"{path} is missing, which {MANIFEST} lists"
    size = path.stat().st_size
    return (
        None
        if size == file.nbytes
        else (f"{path} has {size} bytes, and {file.nbytes} in {MANIFEST}")
    )


def _checked(path: Path, file: File, recipe: Recipe) -> Shard:
    """The file; raises ValueError if its footer has another recipe, seeds or rows than listed."""
    shard = Shard(path)
    difference = shard.recipe.difference(recipe)
    if difference is None and (shard.seeds, shard.rows) != (file.seeds, file.rows):
        difference = f"seeds and rows are {shard.seeds}, {shard.rows} and {file.seeds}, {file.rows}"
    if difference is not None:
        raise ValueError(
            f"{path} is not the file that {MANIFEST} lists, whose {difference}: remove it, and "
            "collect its seeds again"
        )
    return shard


def _command(folder: Path) -> str:
    """The command that finishes a dataset, as far as its log has it."""
    calls = calls_in(folder)
    command = calls[-1].get("command") if calls else None
    if not isinstance(command, str) or not 0 < len(command) < _LONGEST:
        return "the call that collected it"
    return f"`{re.sub(r' --shard[= ][^ ]+', '', command)}`"


class Dataset:
    """Episodes in files, in the order of their seeds.

    Attributes:
      shards: the files, each with an episode of this dataset at least.
      recipe: everything that the episodes depend on except for the seeds.
    """

    def __init__(
        self,
        shards: Sequence[Shard],
        chosen: Sequence[range] | None = None,
        files: Sequence[File] = (),
        gaps: Sequence[range] = (),
    ) -> None:
        """Takes at least one file; all have the same recipe and different seeds.

        Args:
          shards: in the order of their seeds.
          chosen: seeds of each file; all by default.
          files: as the manifest lists them, if there is one.
          gaps: seeds that are wanted and missing.
        """
        self.shards = list(shards)
        self.recipe: Recipe = shards[0].recipe
        self._chosen = [shard.seeds for shard in shards] if chosen is None else list(chosen)
        self._files = {file.name: file for file in files}
        self._gaps = list(gaps)

    @property
    def seeds(self) -> list[int]:
        """The seeds of the episodes."""
        return [seed for seeds in self._chosen for seed in seeds]

    @property
    def gaps(self) -> list[int]:
        """The seeds that were wanted and are missing; empty unless gaps were allowed."""
        return [seed for seeds in self._gaps for seed in seeds]

    @property
    def steps(self) -> int:
        """The steps of all episodes together."""
        return sum(
            sum(shard.lengths[seeds.start - shard.seeds.start : seeds.stop - shard.seeds.start])
            for shard, seeds in zip(self.shards, self._chosen, strict=True)
        )

    def __len__(self) -> int:
        """The number of episodes."""
        return sum(map(len, self._chosen))

    def __iter__(self) -> Iterator[Episode]:
        """The episodes, read one at a time into arrays that must not be changed."""
        for number in range(len(self.shards)):
            yield from self.episodes_of(number)

    def episodes_of(self, number: int) -> Iterator[Episode]:
        """The episodes of a file, by its number."""
        with self.shards[number].opened() as read:
            yield from map(read, self._chosen[number])

    def episode(self, seed: int) -> Episode:
        """The episode of a seed.

        Raises:
          KeyError: there is no such episode.
          ValueError: its file is damaged.
        """
        for shard, seeds in zip(self.shards, self._chosen, strict=True):
            if seed in seeds:
                with shard.opened() as read:
                    return read(seed)
        raise KeyError(f"no episode of seed {seed!r}; the first one has seed {self.seeds[0]}")

    def part(self, k: int, n: int) -> "Dataset":
        """The k-th of n parts, counted from 0, of about as many episodes each.

        It has episodes that follow each other, for a worker of a data loader, which so reads few
        files.

        Raises:
          ValueError: that part has no episode.
        """
        episodes = len(self)
        if not 0 <= k < n <= episodes:
            raise ValueError(f"there is no part {k} of {n} in {episodes} episodes")
        first, end = k * episodes // n, (k + 1) * episodes // n
        shards, chosen, before = list[Shard](), list[range](), 0
        for shard, seeds in zip(self.shards, self._chosen, strict=True):
            here = seeds[max(first - before, 0) : max(end - before, 0)]
            if here:
                shards.append(shard)
                chosen.append(here)
            before += len(seeds)
        return Dataset(shards, chosen, list(self._files.values()))

    def sha256(self) -> dict[str, str]:
        """The SHA-256 of each file by name, in hex: the manifest's, or computed without one."""
        return {
            shard.path.name: (
                self._files[shard.path.name].sha256
                if shard.path.name in self._files
                else sha256_of(shard.path)
            )
            for shard in self.shards
        }

    def verify(self) -> None:
        """Compares the SHA-256 of the files with the manifest's, if there is one.

        Raises:
          ValueError: a file has another one.
        """
        for shard in self.shards:
            listed = self._files.get(shard.path.name)
            if listed is not None and sha256_of(shard.path) != listed.sha256:
                raise ValueError(
                    f"{shard.path} has another SHA-256 than in {MANIFEST}: remove it, and collect "
                    "its seeds again"
                )

    def batches(self, size: int, *, seed: int | None = None) -> Iterator[Batch]:
        """All transitions once, in batches; the last one may be smaller.

        Args:
          size: transitions of a batch.
          seed: shuffles the files, and the transitions within each file; None for the order of
            seeds and steps.

        Raises:
          ValueError: `size` is not a whole number of at least 1, or a file is damaged.
        """
        size = at_least_one("size", size)
        random = None if seed is None else np.random.default_rng(seed)
        order = range(len(self.shards)) if random is None else random.permutation(len(self.shards))
        left: list[Batch] = []
        for number in order:
            left = yield from _batches(_Rows(list(self.episodes_of(number))), size, random, left)
        if left:
            yield _joined(left)


class _Rows:
    """The rows of a file: of each episode one per step, and one for its last observation."""

    def __init__(self, episodes: Sequence[Episode]) -> None:
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


@dataclasses.dataclass(frozen=True)
class Information:
    """Figures of a dataset.

    Attributes:
      recipe: everything that the episodes depend on except for the seeds.
      seeds: of the episodes.
      steps: of all episodes together.
      nbytes: of all files together.
      summary: of all returns.
      strata: of the returns of each kind of start, by name.
      files: the SHA-256 of each file, by name, in hex.
    """

    recipe: Recipe
    seeds: list[int]
    steps: int
    nbytes: int
    summary: Summary
    strata: dict[str, Summary]
    files: dict[str, str]

    def as_json(self) -> dict[str, object]:
        """All of it by name, as values of JSON."""
        return {
            **self.recipe.facts,
            **dataclasses.asdict(self.recipe.kept),
            "columns": {c.name: [c.dtype, *c.shape] for c in self.recipe.columns},
            "seeds": self.seeds,
            "steps": self.steps,
            "bytes": self.nbytes,
            "returns": self.summary.as_json(),
            "strata": {name: part.as_json() for name, part in self.strata.items()},
            "sha256": self.files,
        }


def inform(dataset: Dataset, *, verify: bool = False) -> Information:
    """The figures of a dataset; every page of every file is compared with its checksum.

    Args:
      dataset: whose episodes are read, one at a time.
      verify: compare the SHA-256 of the files with those in the manifest.

    Raises:
      ValueError: a file is damaged, or is another one than the manifest lists.
    """
    if verify:
        dataset.verify()
    scores = [Score.of(episode) for episode in dataset]
    paths = [shard.path for shard in dataset.shards]
    return Information(
        dataset.recipe,
        dataset.seeds,
        dataset.steps,
        sum(path.stat().st_size for path in paths),
        summarise(scores),
        strata(scores),
        dataset.sha256(),
    )
