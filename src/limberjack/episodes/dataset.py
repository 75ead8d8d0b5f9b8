"""`Dataset`: the episodes and transitions of a collection, as arrays that are read on demand.

    dataset = load("data")                          # see `loading`
    for episode in dataset:                         # in the order of the seeds
        print(episode.seed, episode.total)
    for batch in dataset.batches(256, seed=0):      # shuffled; None for the recorded order
        learn(batch.observations["joint_angles"], batch.actions, batch.rewards)
    for windows in dataset.windows(16, stride=8, pad=(0, 15)):
        learn(windows.observations["joint_angles"], windows.actions, windows.mask)
    dataset[3], dataset.transitions([5, 17])        # an episode, and a batch, by number
    dataset.statistics().actions.std                # of each number; computed once
    information = inform(dataset, verify=True)      # returns, sizes, hashes

Only the manifest and footers are read at first, and then one file of episodes at a time, or single
episodes by `transitions`. A dataset may come from anyone: nothing in it is executed, and a damaged
file is an error that names it.

It is one idea, and long: each way to read transitions needs the same files, choices and order.
"""

import bisect
import contextlib
import dataclasses
import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import dm_env
import numpy as np

from limberjack import suite
from limberjack.episodes.column_statistics import Statistics, statistics_of
from limberjack.episodes.environments import inside
from limberjack.episodes.episode import Episode
from limberjack.episodes.manifest import (
    MANIFEST,
    REPAIR,
    DamagedError,
    File,
    Manifest,
    sha256_of,
)
from limberjack.episodes.parquet import Shard
from limberjack.episodes.places import size_of
from limberjack.episodes.reading import (
    Batch,
    Form,
    Reading,
    Recent,
    Rows,
    Windows,
    WindowsOf,
    joined,
    stream,
    taken,
)
from limberjack.episodes.recipe import OBSERVATION, Column, Recipe
from limberjack.episodes.statistics import Score, Summary, strata, summarise
from limberjack.policies import mlp
from limberjack.policies.networks import layout_of
from limberjack.rl.action_specs import bounds_to_try, spec_of
from limberjack.rl.control import shown_by
from limberjack.rl.guards import at_least_one
from limberjack.utils.suggest import did_you_mean

__all__ = ["Dataset", "Information", "inform"]

_LEAST_SCALE = 1e-3  # of observations: a number that never changes stays near 0
_MOST_CACHED = 2**29  # bytes of episodes that `transitions` has read and keeps


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
        reading: Reading = Reading(),  # noqa: B008 (it cannot change)
    ) -> None:
        """Takes at least one file; all have the same recipe and different seeds.

        Args:
          shards: in the order of their seeds.
          chosen: seeds of each file; all by default.
          files: as the manifest lists them, if there is one.
          gaps: seeds that are wanted and missing.
          reading: see `select`.
        """
        self.shards = list(shards)
        self.recipe: Recipe = shards[0].recipe
        self._chosen = [shard.seeds for shard in shards] if chosen is None else list(chosen)
        self._files = {file.name: file for file in files}
        self._gaps = list(gaps)
        self._reading = reading
        self._recent = Recent(_MOST_CACHED)
        self._statistics: Statistics | None = None

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
        return sum(self.lengths)

    @functools.cached_property
    def lengths(self) -> list[int]:
        """The steps of each episode."""
        return [
            length
            for shard, seeds in zip(self.shards, self._chosen, strict=True)
            for length in shard.lengths[
                seeds.start - shard.seeds.start : seeds.stop - shard.seeds.start
            ]
        ]

    @functools.cached_property
    def _ends(self) -> np.ndarray:
        """The number of the transition that follows the last one of each episode."""
        return np.cumsum(self.lengths)

    @functools.cached_property
    def _firsts(self) -> list[int]:
        """The number of the first episode of each file."""
        return [0, *itertools.accumulate(map(len, self._chosen[:-1]))]

    @functools.cached_property
    def observed(self) -> list[str]:
        """The names of the observations that are read, in the order of their columns."""
        names = [c.name.removeprefix(OBSERVATION) for c in self._columns()]
        chosen = self._reading.observations
        return names if chosen is None else [name for name in names if name in chosen]

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

    def selected_of(self, number: int) -> Iterator[Episode]:
        """The episodes of a file, by its number, with the observations of `observed` alone."""
        with self._opened(number) as read:
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

    def __getitem__(self, index: int) -> Episode:
        """The episode of a number from 0 to `len(dataset) - 1`, or from the end if it is negative.

        Raises:
          IndexError: there is no such episode.
          ValueError: its file is damaged.
        """
        episodes = len(self)
        number = operator.index(index)
        if not -episodes <= number < episodes:
            raise IndexError(f"index {number} is out of range; there are {episodes} episodes")
        file, place = self._place(number % episodes)
        with self.shards[file].opened() as read:
            return read(self._chosen[file][place])

    def transitions(self, indices: Sequence[int] | np.ndarray) -> Batch:
        """Some transitions, in the order of their numbers as given.

        The episodes that they belong to are read, and kept in memory up to half a gigabyte: for
        datasets that are much larger, `batches` is faster.

        Args:
          indices: numbers from 0 to `steps - 1`, in the order of seeds and steps, or from the end
            if they are negative; at least one, and the same one may be there repeatedly.

        Raises:
          IndexError: there is no such transition.
          TypeError: they are not whole numbers.
          ValueError: there are none, or a file is damaged.
        """
        wanted = self._checked_indices(indices)
        episodes = np.searchsorted(self._ends, wanted, side="right")
        order = np.argsort(episodes, kind="stable")
        numbers, begins = np.unique(episodes[order], return_index=True)
        groups = np.split(order, begins[1:])
        firsts = self._ends[numbers] - np.array(self.lengths)[numbers]
        parts = [
            rows.take(wanted[group] - first)
            for rows, group, first in zip(self._rows_of(numbers), groups, firsts, strict=True)
        ]
        return taken(joined(parts), np.argsort(order))

    def _checked_indices(self, indices: Sequence[int] | np.ndarray) -> np.ndarray:
        """The numbers of transitions, none of them negative."""
        given = np.asarray(indices)
        if given.ndim != 1 or not len(given):
            raise ValueError(f"indices have shape {given.shape}; expected (N,), at least one")
        if given.dtype.kind not in "iu":
            raise TypeError(f"indices are {given.dtype}; expected whole numbers")
        steps = int(self._ends[-1])
        outside = given[(given < -steps) | (given >= steps)]
        if len(outside):
            raise IndexError(f"index {outside[0]} is out of range; there are {steps} transitions")
        given = given.astype(np.int64)  # a narrower type may not have room for the steps
        return np.where(given < 0, given + steps, given)

    def _rows_of(self, numbers: Iterable[int]) -> Iterator[Rows]:
        """The steps of some episodes, whose numbers increase; those not kept are read."""
        places = ((int(number), *self._place(int(number))) for number in numbers)
        for file, here in itertools.groupby(places, operator.itemgetter(1)):
            with contextlib.ExitStack() as opened:
                read = None
                for number, _, place in here:
                    rows = self._recent.get(number)
                    if rows is None:
                        read = read or opened.enter_context(self._opened(file))
                        seed = self._chosen[file][place]
                        rows = self._recent.put(number, Rows([read(seed)], self._reading))
                    yield rows

    def _place(self, number: int) -> tuple[int, int]:
        """The number of the file of an episode, and that of the episode in it."""
        file = bisect.bisect_right(self._firsts, number) - 1
        return file, number - self._firsts[file]

    def _opened(self, number: int) -> contextlib.AbstractContextManager[Callable[[int], Episode]]:
        """A function that reads episodes of a file with the chosen observations."""
        return self.shards[number].opened(self.observed)

    def select(
        self,
        observations: Iterable[str] | None = None,
        *,
        float32: bool | None = None,
        discount: float | None = None,
        n_step: int | None = None,
    ) -> "Dataset":
        """The same episodes; `batches`, `windows`, `transitions` and `statistics` differ.

        A choice that is left out stays as it is in this dataset: of the files, all observations,
        float64, no discount, and single steps.

        Args:
          observations: the names of those to read, some of `observed`.
          float32: observations, actions, rewards and returns as float32 instead of float64.
          discount: of a reward one step later, from 0 to 1. Batches then have `discounts` and
            `returns_to_go`, and windows `returns_to_go`.
          n_step: transitions of so many steps, with discounted sums of rewards; windows have the
            rewards of single steps.

        Raises:
          ValueError: there is no such observation, or a number is out of range.
        """
        if discount is not None and not 0 <= discount <= 1:
            raise ValueError(f"discount is {discount!r}; expected a number from 0 to 1")
        given = {
            "observations": None if observations is None else self._checked_names(observations),
            "float32": float32,
            "discount": discount,
            "n_step": None if n_step is None else at_least_one("n_step", n_step),
        }
        changes = {name: value for name, value in given.items() if value is not None}
        reading = dataclasses.replace(self._reading, **changes)
        if reading.n_step > 1 and reading.discount is None:
            raise ValueError(
                f"n_step is {reading.n_step}, and there is no discount; give 1.0 for sums"
            )
        files = list(self._files.values())
        return Dataset(self.shards, self._chosen, files, self._gaps, reading)

    def _checked_names(self, observations: Iterable[str]) -> tuple[str, ...]:
        """The names of some observations; raises an error if they are none that are read here."""
        chosen, names = tuple(observations), self.observed
        for name in chosen:
            if name not in names:
                raise ValueError(
                    f"unknown column {name!r}; the observations are {', '.join(names)}."
                    f"{did_you_mean(name, names)}"
                )
        if not chosen:
            raise ValueError(f"observations is empty; choose from {', '.join(names)}")
        return chosen

    def _columns(self) -> list[Column]:
        """The columns of observations."""
        return [c for c in self.recipe.columns if c.name.startswith(OBSERVATION)]

    def statistics(self) -> Statistics:
        """Mean, deviation, range and quantiles of each number but pixels, in one pass, and kept.

        Raises:
          ValueError: a file is damaged.
        """
        if self._statistics is None:
            names = {OBSERVATION + name for name in self.observed}
            wanted = {*names, "action", "reward"}
            columns = (c for c in self.recipe.columns if c.name in wanted and c.has_figures)
            recipe = dataclasses.replace(self.recipe, columns=tuple(columns))
            files = map(self.selected_of, range(len(self.shards)))
            self._statistics = statistics_of(files, recipe, self.lengths)
        return self._statistics

    def policy_card(
        self,
        algorithm: str,
        environment: dm_env.Environment | None = None,
        *,
        action_bound: float = 1.0,
    ) -> mlp.Card:
        """The card of a policy that learns from this dataset, for `mlp.save`.

        Its observations are normalised by the statistics of the dataset.

        Args:
          algorithm: that learns, such as 'behaviour cloning'.
          environment: whose observations and actions the policy has; None for the suite's task.
          action_bound: largest absolute action, where the task has no bounds of its own.

        Raises:
          ValueError: the dataset is of no task of the suite, or lacks an observation,
            or the environment has none but pictures, or actions of another number of axes than
            one, or `action_bound` is no positive number.
        """
        if not 0 < action_bound < math.inf:
            raise ValueError(f"action_bound is {action_bound!r}; expected a positive number")
        facts = self.recipe.facts
        if environment is None:
            if "domain" not in facts:
                raise ValueError("the dataset is of no task of the suite: pass its environment")
            environment = suite.load(facts["domain"], facts["task"], None, facts.get("world"))
        layout, actions = layout_of(environment), spec_of(environment)
        if not layout:
            raise ValueError("the environment observes no numbers, which a policy file needs")
        if len(actions.shape) != 1:
            raise ValueError(f"actions have shape {actions.shape}; expected one axis, such as (2,)")
        observed = self.statistics().observations
        for name, _ in layout:
            if name not in observed:
                raise ValueError(
                    f"the dataset has no observation {name!r}, which the environment has; it has: "
                    f"{', '.join(observed)}"
                )
        mean, deviation = (
            np.concatenate([np.ravel(getattr(observed[name], part)) for name, _ in layout])
            for part in ("mean", "std")
        )
        low, high = (
            tuple(bound.ravel().tolist()) for bound in bounds_to_try(actions, action_bound)
        )
        return mlp.Card(
            layout,
            low,
            high,
            action_repeat=facts["action_repeat"],
            domain=facts.get("domain") or "",
            task=facts.get("task") or "",
            mean=tuple(mean.tolist()),
            scale=tuple((deviation + _LEAST_SCALE).tolist()),
            algorithm=algorithm,
            world=shown_by(inside(environment), "world"),
        )

    def part(self, k: int, n: int) -> "Dataset":
        """The k-th of n parts, counted from 0; their numbers of episodes differ by at most one.

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
        return Dataset(shards, chosen, list(self._files.values()), reading=self._reading)

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
        """Compares the files with the manifest, if there is one: SHA-256, returns and statistics.

        Returns and statistics are compared if this is all of a dataset in a folder.

        Raises:
          ValueError: they differ.
        """
        for shard in self.shards:
            listed = self._files.get(shard.path.name)
            if listed is not None and sha256_of(shard.path) != listed.sha256:
                raise DamagedError(f"{shard.path} has another SHA-256 than in {MANIFEST}: {REPAIR}")
        first = self.shards[0].path
        is_whole = self._files.keys() == {shard.path.name for shard in self.shards}
        if self._files and isinstance(first, Path) and is_whole:
            path = first.parent.parent / MANIFEST
            if (manifest := Manifest.read(path)) is not None:
                manifest.check(path, [shard.figures() for shard in self.shards])

    def batches(self, size: int, *, seed: int | None = None, buffer: int = 0) -> Iterator[Batch]:
        """All transitions once, in batches; the last one may be smaller.

        Args:
          size: transitions of a batch.
          seed: shuffles the files, and the transitions within each file; None for the order of
            seeds and steps. The order of transitions depends on the seed and the buffer alone.
          buffer: so many transitions of each file, drawn at random, are left to be shuffled with
            the next one, so that a batch has transitions of several files.

        Raises:
          ValueError: a number is out of range, or there is a buffer without a seed. Or, while they
            are read, a file is damaged.
        """
        size, buffer = at_least_one("size", size), _checked_buffer(buffer, seed)
        random = None if seed is None else np.random.default_rng(seed)
        return stream(self._rows(random), size, random, buffer)

    def windows(
        self,
        length: int,
        stride: int = 1,
        pad: tuple[int, int] = (0, 0),
        *,
        size: int = 256,
        seed: int | None = None,
        buffer: int = 0,
    ) -> Iterator[Windows]:
        """All windows of steps that follow each other in an episode, in batches.

        Args:
          length: steps of a window.
          stride: steps from the beginning of a window to that of the next one.
          pad: the steps by which windows may begin before an episode, and end after it; both less
            than `length`. The first window of an episode begins as early as it may.
          size: windows of a batch; the last one may be smaller.
          seed, buffer: as for `batches`, with windows in the place of transitions.

        Raises:
          ValueError: a number is out of range, there is a buffer without a seed, or no episode is
            long enough for a window. Or, while they are read, a file is damaged.
        """
        if not self.count_windows(length, stride, pad):
            longest = max(self.lengths) + sum(pad)
            raise ValueError(
                f"length is {length}; expected at most {longest}, the steps of the longest episode"
                f"{' and its padding' if sum(pad) else ''}"
            )
        form = _form(length, stride, pad)
        size, buffer = at_least_one("size", size), _checked_buffer(buffer, seed)
        random = None if seed is None else np.random.default_rng(seed)
        sources = (WindowsOf(rows, form) for rows in self._rows(random))
        return stream(sources, size, random, buffer)

    def count_windows(self, length: int, stride: int = 1, pad: tuple[int, int] = (0, 0)) -> int:
        """The number of windows that `windows` gives with these arguments; it reads nothing.

        Raises:
          ValueError: a number is out of range.
        """
        return int(_form(length, stride, pad).counts(np.array(self.lengths)).sum())

    def _rows(self, random: np.random.Generator | None) -> Iterator[Rows]:
        """The steps of each file, of which one is in memory at a time."""
        files = len(self.shards)
        for number in range(files) if random is None else random.permutation(files):
            yield Rows(list(self.selected_of(number)), self._reading)


def _form(length: int, stride: int, pad: tuple[int, int]) -> Form:
    """The form of windows; raises ValueError if a number is out of range."""
    length, stride = at_least_one("length", length), at_least_one("stride", stride)
    is_pair = isinstance(pad, tuple | list) and len(pad) == 2
    if not (is_pair and all(_is_count(steps) and steps < length for steps in pad)):
        raise ValueError(
            f"pad is {pad!r}; expected steps before and after an episode, whole numbers from 0 to "
            f"{length - 1}, less than the length"
        )
    return Form(length, stride, *map(int, pad))


def _is_count(value: object) -> bool:
    """Whether a value is a whole number of at least 0."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        return False
    return bool(value >= 0)


def _checked_buffer(buffer: int, seed: int | None) -> int:
    if not _is_count(buffer):
        raise ValueError(f"buffer is {buffer!r}; expected a whole number of at least 0")
    if buffer and seed is None:
        raise ValueError(f"buffer is {buffer}, and there is no seed to shuffle with; give one")
    return buffer


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
            **self.recipe.kept.as_json(),
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
        sum(map(size_of, paths)),
        summarise(scores),
        strata(scores),
        dataset.sha256(),
    )
