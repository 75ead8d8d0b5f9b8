"""`Folder`: the files of a dataset, to which a collection adds.

    with Folder(Path("data"), recipe) as folder:
        for seeds in blocks(folder.plan(range(1000)), 64):
            folder.add(seeds, content)
        folder.finish()

A file has the episodes of one block of seeds, as many as the recipe says, and is named by its
seeds. It is written in `parts` and moved to `episodes` once it is complete. Where it has more
episodes than are played together, they wait in `parts` and are joined, one episode at a time. Files
are never written again: seeds that are added to a block have a file of their own.

`finish` writes the manifest dataset.json and the card README.md. A shard plays some of the seeds.
It joins the files that have its seeds only, and lists them in parts/dataset-K-of-N.json; the rest
is left to the process without a shard. `run.json` has what the files must not depend on: times,
hosts, numbers of workers.
"""

import bisect
import collections
import contextlib
import itertools
import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from limberjack.episodes.manifest import (
    CARD_LINE,
    EPISODES,
    MANIFEST,
    PARTS,
    File,
    Manifest,
    card,
    file_name,
    named_seeds,
    sha256_of,
    united,
    without,
)
from limberjack.episodes.parquet import Shard, join
from limberjack.episodes.recipe import Recipe
from limberjack.utils.facts import Facts
from limberjack.utils.files import Hold, read_regular, replacing

__all__ = ["Folder", "blocks", "calls_in", "check_distinct", "discard_other"]

_CARD = "README.md"
_ENDING = "part"  # of unfinished files, so that no reader of Parquet files takes them
_RECORDS = "dataset-*-of-*.json"
_RUNS = "run*.json"
_UNFINISHED = re.compile(r"\.seeds-(\d{10})-\d{10}\.[0-9a-f]+\.part")  # see `utils.files.Partial`
_TRIES = 10  # writes of a file, whose folder another process may remove in between


def check_distinct(shards: Sequence[Shard]) -> None:
    """Raises ValueError if files, in the order of their names, are not of one dataset."""
    for one, following in itertools.pairwise(shards):
        difference = one.recipe.difference(following.recipe)
        if difference is not None:
            raise ValueError(
                f"{one.path} and {following.path} are of different datasets, whose {difference}: "
                "move one of them into another folder"
            )
        if following.seeds.start < one.seeds.stop:
            raise ValueError(
                f"{one.path} and {following.path} both have the episode of seed "
                f"{following.seeds.start}: remove one of them"
            )


def blocks(seeds: Iterable[int], size: int) -> Iterator[range]:
    """The seeds, which are increasing, as ranges within one block each, aligned at its size."""
    first = last = None
    for seed in seeds:
        if first is None or last is None:
            first = seed
        elif seed != last + 1 or seed % size == 0:
            yield range(first, last + 1)
            first = seed
        last = seed
    if first is not None and last is not None:
        yield range(first, last + 1)


class Folder:
    """See the module's docstring; `directory` is its path."""

    def __init__(
        self, directory: Path, recipe: Recipe, shard: tuple[int, int] | None = None
    ) -> None:
        """Opens a folder, which is created if needed.

        Args:
          directory: of the dataset.
          recipe: of the episodes to be added.
          shard: (k, n) of one of n processes that write here, each its own seeds; None if this
            one is alone.

        Raises:
          ValueError: its files have another recipe or are damaged, or another process writes here;
            nothing was changed.
          OSError: a file cannot be read.
        """
        self.directory = directory
        self._episodes, self._parts = directory / EPISODES, directory / PARTS
        self._recipe = recipe
        self._shard = None if shard is None else "{}-of-{}".format(*shard)
        self._run = directory / ("run.json" if shard is None else f"run-{self._shard}.json")
        directory.mkdir(parents=True, exist_ok=True)
        self._hold = Hold(directory if shard is None else self._run)
        try:
            self._check()
            self.calls()
        except BaseException:
            self._hold.release()
            raise
        self._logged: bytes | None = None  # the content of run.json, once this process wrote it
        self._made: dict[str, File] = {}  # files that this process wrote, by name
        self._there: list[range] = []  # the seeds of files that were finished before
        self._wanted: list[range] = []
        self._own: list[range] = []  # the wanted seeds that this process plays
        self._targets: list[range] = []  # files to be written, in the order of their seeds
        self._left: dict[int, int] = {}  # episodes that one lacks, by its first seed
        self._part_of: dict[int, Shard] = {}  # the part that has a seed
        self._seeds_in: collections.Counter[str] = collections.Counter()  # of each part

    def __enter__(self) -> "Folder":
        return self

    def __exit__(self, *error: object) -> None:
        self._hold.release()

    def _check(self) -> None:
        """Raises ValueError if the files are damaged or of another dataset.

        A shard opens one file only: the process without a shard opens them all in the end.
        """
        if any(self.directory.glob("seeds-*.parquet")):
            raise ValueError(
                f"{self.directory} has a dataset of format 1, to which nothing can be added: "
                "choose another folder"
            )
        self._manifest = Manifest.read(self.directory / MANIFEST)
        if self._manifest is not None:
            self._check_recipe(self.directory / MANIFEST, self._manifest.recipe)
        paths = self._finished()
        shards = [self._opened(path) for path in (paths if self._shard is None else paths[:1])]
        check_distinct(shards)
        if self._shard is None:
            self._records = self._read_records()

    def _read_records(self) -> dict[str, File]:
        """The files that are listed in the manifest and by shards."""
        manifests = [self._manifest]
        for path in sorted(self._parts.glob(_RECORDS)):
            manifests.append(record := Manifest.read(path))
            if record is not None:
                self._check_recipe(path, record.recipe)
        return {file.name: file for one in manifests if one is not None for file in one.files}

    def _finished(self) -> list[Path]:
        """The files of episodes, in the order of their seeds."""
        return _named(self._episodes, "parquet")

    def _opened(self, path: Path) -> Shard:
        shard = Shard(path)
        if named_seeds(path.name) != shard.seeds:
            raise ValueError(
                f"{path} has the episodes of {file_name(shard.seeds)}: give it its name back, or "
                "remove it"
            )
        self._check_recipe(path, shard.recipe)
        return shard

    def _check_recipe(self, path: Path, recipe: Recipe) -> None:
        difference = recipe.difference(self._recipe)
        if difference is not None:
            raise ValueError(
                f"{path} belongs to another dataset than the one asked for, whose {difference}: "
                "choose another folder"
            )

    def plan(self, seeds: Sequence[int], own: Sequence[int] | None = None) -> list[int]:
        """The seeds to be played, whose episodes are not here.

        Args:
          seeds: all that are wanted, increasing; they decide which files there will be.
          own: those of a shard; all by default.

        Raises:
          ValueError: the episodes may not fit onto the disk, or a part is damaged or of another
            dataset; nothing was changed.
        """
        size = self._recipe.block
        self._there = there = united(_seeds_of(path) for path in self._finished())
        self._part_of.clear()
        self._seeds_in.clear()
        self._wanted = list(_runs(seeds))
        self._own = self._wanted if own is None else list(_runs(own))
        lacking = without(self._wanted, there)
        targets = [one for run in lacking for one in blocks(run, size)]
        self._targets = [one for one in targets if _is_within(one, self._own)]
        self._left = {one.start: len(one) for one in self._targets}
        mine = without(self._own, there)
        useless = self._take_parts(mine)
        missing = [seed for run in mine for seed in run if seed not in self._part_of]
        largest = max(map(len, self._targets), default=0)  # is here twice while it is joined
        needed = self._recipe.most_nbytes(len(missing) + largest, len(self._targets) + 1)
        free = shutil.disk_usage(self.directory).free
        if missing and needed > free:
            raise ValueError(
                f"{len(missing)} episodes may take {_size(needed)}, and {self.directory} has "
                f"{_size(free)} left: give fewer seeds, another folder, or keep less of each step"
            )
        for path in useless:
            path.unlink(missing_ok=True)
        for target in self._targets:
            self._join(target)
        return missing

    def _take_parts(self, mine: Sequence[range]) -> list[Path]:
        """Takes the parts that have some of these seeds; returns those of finished files."""
        useless: list[Path] = []
        for path in _named(self._parts, _ENDING):
            seeds = _seeds_of(path)
            if _meets(seeds, mine):
                with contextlib.suppress(FileNotFoundError):  # another process has joined it
                    self._take(self._opened(path))
            elif self._shard is None and _is_within(seeds, self._there):
                useless.append(path)
        return useless

    def _take(self, part: Shard) -> None:
        """Counts a part's episodes for the files to which they belong."""
        for seed in part.seeds:
            if seed in self._part_of or _range_with(seed, self._there) is not None:
                continue
            self._part_of[seed] = part
            self._seeds_in[part.path.name] += 1
            target = _range_with(seed, self._targets)
            if target is not None:
                self._left[target.start] -= 1

    def add(self, seeds: range, content: bytes) -> None:
        """Writes episodes that `plan` has named: a whole file, or a part of one.

        Raises:
          OSError: the file cannot be written, as on a full disk; nothing is left of it. Or another
            process writes to this folder, where there are no locks.
        """
        self._check_alone()
        if _range_with(seeds.start, self._targets) == seeds:
            self._write(seeds, lambda partial: partial.write_bytes(content))
            return
        path = self._parts / file_name(seeds, _ENDING)
        self._replace(path, lambda partial: partial.write_bytes(content))
        self._take(Shard(path))
        target = _range_with(seeds.start, self._targets)
        if target is not None:
            self._join(target)

    def _join(self, seeds: range) -> None:
        """Writes a file if its parts are all here, and removes the parts."""
        if self._left[seeds.start]:
            return
        part_of = self._part_of
        self._write(seeds, lambda partial: join(self._recipe, seeds, part_of.__getitem__, partial))
        for seed in seeds:
            name = part_of.pop(seed).path.name
            self._seeds_in[name] -= 1
            if not self._seeds_in[name]:
                (self._parts / name).unlink(missing_ok=True)

    def _write(self, seeds: range, fill: Callable[[Path], object]) -> None:
        """Writes a file of episodes, and keeps its entry of the manifest."""
        path = self._episodes / file_name(seeds)
        self._replace(path, fill)
        self._left[seeds.start] = len(seeds)  # it is not joined again
        self._made[path.name] = _file_of(path)

    def _replace(self, path: Path, fill: Callable[[Path], object]) -> None:
        """Writes a file, also while another process removes the folder of parts, empty to it."""
        for _ in range(_TRIES):
            self._parts.mkdir(exist_ok=True)
            path.parent.mkdir(exist_ok=True)
            with contextlib.suppress(FileNotFoundError):
                self._replace_once(path, fill)
                return
        self._replace_once(path, fill)

    def _replace_once(self, path: Path, fill: Callable[[Path], object]) -> None:
        try:
            with replacing(path, f".{_ENDING}", self._parts) as partial:
                fill(partial)
        except FileNotFoundError:  # another process that began here has removed it as unfinished
            self._check_alone()
            raise

    def finish(self) -> None:
        """Writes the manifest and the card, or what a shard knows, if they are others than before.

        Raises:
          ValueError: a file is damaged.
          OSError: one cannot be read or written.
        """
        if self._shard is not None:
            self._write_record()
            return
        files = [self._file(path) for path in self._finished()]
        before = [] if self._manifest is None else self._manifest.wanted
        wanted = united([*before, *self._wanted, *(file.seeds for file in files)])
        manifest = Manifest(self._recipe, wanted, files)
        if manifest != self._manifest or not (self.directory / _CARD).exists():
            figures = [Shard(self._episodes / file.name).figures() for file in files]
            self._write_card(card(manifest, figures))
            with replacing(self.directory / MANIFEST) as partial:
                partial.write_text(manifest.text(figures), "utf-8")
        for path in self._parts.glob(_RECORDS):
            path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # it is missing, or has parts
            self._parts.rmdir()

    def _write_record(self) -> None:
        """Writes the list of a shard's files."""
        paths = [path for path in self._finished() if _is_within(_seeds_of(path), self._own)]
        path = self._parts / f"dataset-{self._shard}.json"
        known = Manifest.read(path)
        self._records = {file.name: file for file in known.files} if known else {}
        record = Manifest(self._recipe, self._own, [self._file(path) for path in paths])
        if record != known:
            self._replace(path, lambda partial: partial.write_text(record.text(), "utf-8"))

    def _file(self, path: Path) -> File:
        """The entry of a file in the manifest.

        The file is read again if no process that finished has kept it.
        """
        file = self._made.get(path.name) or self._records.get(path.name)
        if file is not None and file.nbytes == path.stat().st_size:
            return file
        return _file_of(path)

    def _write_card(self, text: str) -> None:
        path = self.directory / _CARD
        if path.exists() and CARD_LINE.encode() not in read_regular(path):
            return  # it is the user's
        with replacing(path) as partial:
            partial.write_text(text, "utf-8")

    def log(self, call: Mapping[str, object]) -> None:
        """Writes a call to run.json, in the place of an entry that began at the same time."""
        is_first = self._logged is None
        earlier = [one for one in _calls(self._run) if one.get("began") != call["began"]]
        with replacing(self._run) as partial:
            text = json.dumps({"calls": [*earlier, call]}, indent=2)
            partial.write_text(f"{text}\n", "utf-8")
            self._logged = partial.read_bytes()
        if is_first:
            self._remove_unfinished()

    def _remove_unfinished(self) -> None:
        """Removes unfinished files of a process that was killed; other writers have other seeds."""
        for path in self._parts.glob(".seeds-*"):
            found = _UNFINISHED.fullmatch(path.name)
            if found and _range_with(int(found[1]), self._own) is not None:
                path.unlink(missing_ok=True)

    def _check_alone(self) -> None:
        """Raises OSError if another process has logged a call since, for want of locks."""
        if self._logged is None or not self._run.exists():
            return
        if read_regular(self._run) == self._logged:
            return
        raise OSError(
            f"another process writes to {self.directory}: end one of the two, or choose another "
            "folder"
        )

    def calls(self) -> list[Facts]:
        """The calls that were logged here, those of shards too; see `calls_in`."""
        return calls_in(self.directory)


def discard_other(directory: Path, recipe: Recipe) -> None:
    """Removes the dataset of a folder if it is one of another recipe; other files stay.

    Raises:
      ValueError: it is damaged, or another process writes there.
      OSError: it cannot be read or removed.
    """
    episodes, parts = directory / EPISODES, directory / PARTS
    shards = [*_named(episodes, "parquet"), *_named(parts, _ENDING)]
    if not shards or Shard(shards[0]).recipe.difference(recipe) is None:
        return
    with Hold(directory):
        (directory / MANIFEST).unlink(missing_ok=True)
        card = directory / _CARD
        if card.exists() and CARD_LINE.encode() in read_regular(card):
            card.unlink()
        for path in [*shards, *directory.glob(_RUNS), *parts.glob(_RECORDS)]:
            path.unlink(missing_ok=True)
        for folder in (episodes, parts):
            with contextlib.suppress(OSError):  # it is missing, or has other files
                folder.rmdir()


def calls_in(directory: Path) -> list[Facts]:
    """The calls that were logged in a dataset's folder, those of shards too.

    Raises:
      ValueError: a log is damaged.
    """
    return [call for path in sorted(directory.glob(_RUNS)) for call in _calls(path)]


def _calls(path: Path) -> list[Facts]:
    """The calls in a log; none where there is no file.

    Raises:
      ValueError: it is damaged, or has more than calls and so is something else.
    """
    if not os.path.lexists(path):
        return []
    content = read_regular(path)
    try:
        log = json.loads(content)
        calls = [dict(call) for call in log["calls"]]
    except (KeyError, RecursionError, TypeError, ValueError):
        raise ValueError(f"{path} is damaged: remove it, or choose another folder") from None
    if log.keys() != {"calls"} or not all("began" in call for call in calls):
        raise ValueError(f"{path} is no log of a collection: choose another folder")
    return calls


def _named(folder: Path, ending: str) -> list[Path]:
    """The files that are named by seeds, in their order."""
    paths = folder.glob(f"seeds-*.{ending}")
    return sorted(path for path in paths if named_seeds(path.name) is not None)


def _seeds_of(path: Path) -> range:
    seeds = named_seeds(path.name)
    assert seeds is not None, path
    return seeds


def _file_of(path: Path) -> File:
    shard = Shard(path)
    return File(shard.seeds, shard.rows, path.stat().st_size, sha256_of(path))


def _runs(seeds: Iterable[int]) -> Iterator[range]:
    """The seeds, which are increasing, as ranges that do not touch."""
    return blocks(seeds, 2**64)


def _range_with(seed: int, ranges: Sequence[range]) -> range | None:
    """The range, of increasing ones, that has a seed."""
    number = bisect.bisect_right(ranges, seed, key=lambda one: one.start) - 1
    return ranges[number] if number >= 0 and seed in ranges[number] else None


def _is_within(seeds: range, ranges: Sequence[range]) -> bool:
    """Whether one of increasing ranges has all of the seeds."""
    found = _range_with(seeds.start, ranges)
    return found is not None and seeds[-1] in found


def _meets(seeds: range, ranges: Sequence[range]) -> bool:
    """Whether one of increasing ranges has some of the seeds."""
    number = bisect.bisect_right(ranges, seeds.start, key=lambda one: one.stop)
    return number < len(ranges) and ranges[number].start < seeds.stop


def _size(nbytes: float) -> str:
    return f"{nbytes / 1e9:.3g} GB" if nbytes >= 1e9 else f"{nbytes / 1e6:.3g} MB"
