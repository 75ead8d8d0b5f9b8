"""`Folder`: the files of a dataset, to which a collection adds.

    with Folder(Path("data"), recipe) as folder:
        for seeds in blocks(folder.plan(range(1000)), 64):
            for file, order in folder.add(seeds, content):      # or `took`, if a worker has written
                folder.join(file, order)                        # or a worker does
        folder.finish()

A file has the episodes of one block of seeds, as many as the recipe says, and is named by its
seeds. Where it has more episodes than are played together, they wait in `parts` and are joined, one
row group at a time. Files are never written again: seeds that are added to a block have a file of
their own. `writing` does all of this with a file; here is the list of what is there, which is
read from the names alone, and of what is missing. Nothing is done twice for an episode.

`finish` writes the manifest dataset.json and the card README.md. A shard plays some of the seeds.
It joins the files that have its seeds only, and lists them in parts/dataset-K-of-N.json; the rest
is left to the process without a shard. `run.json` has what the files must not depend on: times,
hosts, numbers of workers.
"""

import bisect
import contextlib
import dataclasses
import itertools
import json
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from limberjack.episodes.card import CARD, CARD_LINE, write_card
from limberjack.episodes.manifest import (
    EPISODES,
    MANIFEST,
    PARTS,
    File,
    Manifest,
    check_name,
    check_recipe,
    damage_reported,
    file_name,
    named_seeds,
    united,
    without,
)
from limberjack.episodes.parquet import Shard
from limberjack.episodes.places import (
    Place,
    exists,
    filling,
    named,
    read,
    size_of,
)
from limberjack.episodes.recipe import Recipe
from limberjack.episodes.writing import ENDING, FILE, LIST, PART, Order, Writing, joining, listed
from limberjack.see.report.result import EVALUATION
from limberjack.utils.files import Hold, random_letters, read_regular

__all__ = ["Folder", "blocks", "calls_in", "check_distinct", "discard_other"]

_RECORDS = "dataset-*-of-*.json"
_RUNS = "run*.json"
_UNFINISHED = re.compile(r"\.seeds-(\d{10})-\d{10}\.[0-9a-f]+\.part")  # see `utils.files.Partial`
_PROBE = ".probe-"
_LETTERS = "[0-9a-f]" * len(random_letters())  # a pattern


def check_distinct(shards: Sequence[Shard]) -> None:
    """Raises ValueError if files, in the order of their names, are not of one dataset."""
    for one, following in itertools.pairwise(shards):
        difference = one.recipe.difference(following.recipe)
        if difference is not None:
            raise ValueError(
                f"{one.path} and {following.path} are of different datasets, whose {difference}: "
                "move one of them into another folder"
            )
    _check_apart([(shard.path, shard.seeds) for shard in shards])


def _check_apart(files: Sequence[tuple[object, range]]) -> None:
    """Raises ValueError if two files, in the order of their names, have an episode of one seed."""
    for (one, seeds), (following, others) in itertools.pairwise(files):
        if others.start < seeds.stop:
            raise ValueError(
                f"{one} and {following} both have the episode of seed {others.start}: remove one "
                "of them"
            )


def blocks(seeds: Iterable[int], size: int) -> Iterator[range]:
    """The seeds, which are increasing, as ranges within one block each, aligned at its size."""

    def place(numbered: tuple[int, int]) -> tuple[int, int]:
        number, seed = numbered
        return seed - number, seed // size  # the first one stays the same within a run

    for _, run in itertools.groupby(enumerate(seeds), place):
        found = [seed for _, seed in run]
        yield range(found[0], found[-1] + 1)


class Folder:
    """See the module's docstring.

    Attributes:
      directory: its place.
      writing: writes files of episodes in this process.
    """

    def __init__(
        self, directory: Place, recipe: Recipe, shard: tuple[int, int] | None = None
    ) -> None:
        """Opens a folder, which is created if needed.

        One file is opened, and one part of a file, to compare their recipe; `finish` opens the
        others.

        Args:
          directory: of the dataset.
          recipe: of the episodes to be added.
          shard: (k, n) of one of n processes that write here, each its own seeds; None if this
            one is alone.

        Raises:
          ValueError: it is a file, its files have another recipe or are damaged, or another process
            writes here; nothing was changed.
          OSError: a file cannot be read.
        """
        self.directory = directory
        self.writing = Writing(directory, recipe)
        self._episodes, self._parts = directory / EPISODES, directory / PARTS
        self._recipe = recipe
        self._shard = None if shard is None else "{}-of-{}".format(*shard)
        self._run = directory / ("run.json" if shard is None else f"run-{self._shard}.json")
        if isinstance(directory, Path) and exists(directory) and not directory.is_dir():
            raise ValueError(f"{directory} is no folder: choose another name")
        directory.mkdir(parents=True, exist_ok=True)
        self._hold: Hold | None = None  # a server has no locks
        if isinstance(directory, Path) and isinstance(self._run, Path):
            self._hold = Hold(directory if shard is None else self._run)
        try:
            self._check()
            self.calls()
        except BaseException:
            self._release()
            raise
        self._logged: bytes | None = None  # the content of run.json, once this process wrote it
        self._made: dict[str, File] = {}  # files that were written for this process, by name
        self._there: list[range] = []  # the seeds of files that were finished before
        self._wanted: list[range] = []
        self._own: list[range] = []  # the wanted seeds that this process plays
        self._targets: list[range] = []  # files to be written, in the order of their seeds
        self._left: dict[int, int] = {}  # episodes that one lacks, by its first seed
        self._parts_of: dict[int, list[range]] = {}  # the parts of one, likewise

    def __enter__(self) -> "Folder":
        return self

    def __exit__(self, *error: object) -> None:
        self._release()

    def _release(self) -> None:
        if self._hold is not None:
            self._hold.release()

    def _check(self) -> None:
        """Raises ValueError if the files are of another dataset, or those that it opens damaged."""
        if named(self.directory, "seeds-*.parquet"):
            raise ValueError(
                f"{self.directory} has a dataset of format 1, to which nothing can be added: "
                "choose another folder"
            )
        self._manifest = Manifest.read(self.directory / MANIFEST)
        if self._manifest is not None:
            check_recipe(self.directory / MANIFEST, self._manifest.recipe, self._recipe)
        elif named(self.directory, EVALUATION):
            raise ValueError(f"{self.directory} holds an evaluation: choose another folder")
        parts, files = _seeds_in(self._parts, ENDING), _seeds_in(self._episodes)
        _check_apart([(self._episodes / file_name(seeds), seeds) for seeds in files])
        for seeds in files[:1]:
            self._opened(self._episodes / file_name(seeds))
        for seeds in parts[:1]:
            with contextlib.suppress(FileNotFoundError):  # another process has joined it
                self._opened(self._parts / file_name(seeds, ENDING))
        if self._shard is None:
            self._records = self._read_records()

    def _read_records(self) -> dict[str, File]:
        """The files that are listed in the manifest and by shards."""
        manifests = [self._manifest]
        for path in named(self._parts, _RECORDS):
            manifests.append(record := Manifest.read(path))
            if record is not None:
                check_recipe(path, record.recipe, self._recipe)
        return {file.name: file for one in manifests if one is not None for file in one.files}

    def _opened(self, path: Place) -> Shard:
        shard = Shard(path)
        check_name(path, shard.seeds)
        check_recipe(path, shard.recipe, self._recipe)
        return shard

    def plan(self, seeds: Sequence[int], own: Sequence[int] | None = None) -> list[int]:
        """The seeds to be played, whose episodes are not here; then `ready` has what to join.

        Args:
          seeds: all that are wanted, increasing; they decide which files there will be.
          own: those of a shard; all by default.

        Raises:
          ValueError: the episodes may not fit onto the disk; nothing was changed.
        """
        # Parts first: one that another process removes then is in a file that is listed.
        parts = _seeds_in(self._parts, ENDING)
        self._there = there = united(_seeds_in(self._episodes))
        self._wanted = list(_runs(seeds))
        self._own = self._wanted if own is None else list(_runs(own))
        lacking = without(self._wanted, there)
        targets = [one for run in lacking for one in blocks(run, self._recipe.block)]
        self._targets = [one for one in targets if _is_within(one, self._own)]
        self._count(parts)
        missing = without(without(self._own, there), united(parts))
        self._check_room(sum(map(len, missing)))
        if self._shard is None:
            self._remove_useless(parts, there)
        return [seed for run in missing for seed in run]

    def _count(self, parts: Sequence[range]) -> None:
        """Counts the episodes that each file lacks, and keeps the parts that it has."""
        self._left = {one.start: 0 for one in self._targets}
        self._parts_of = {one.start: [] for one in self._targets}
        for run in without(self._targets, united(parts)):
            target = _range_with(run.start, self._targets)
            assert target is not None, run
            self._left[target.start] += len(run)
        for part in parts:
            for target in _meeting(part, self._targets):
                self._parts_of[target.start].append(part)

    def _check_room(self, missing: int) -> None:
        """Raises ValueError if episodes may not fit onto the disk; a server's is unknown."""
        if not missing or not isinstance(self.directory, Path):
            return
        largest = max(map(len, self._targets), default=0)  # is here twice while it is joined
        needed = self._recipe.most_nbytes(missing + largest, len(self._targets) + 1)
        free = shutil.disk_usage(self.directory).free
        if needed > free:
            raise ValueError(
                f"{missing} episodes may take {_size(needed)}, and {self.directory} has "
                f"{_size(free)} left: give fewer seeds, another folder, or keep less of each step"
            )

    def _remove_useless(self, parts: Sequence[range], there: Sequence[range]) -> None:
        """Removes the parts of finished files."""
        for part in parts:
            if _is_within(part, there):
                (self._parts / file_name(part, ENDING)).unlink(missing_ok=True)

    def ready(self) -> list[tuple[range, Order]]:
        """Files whose parts are all here as `plan` ends, and how to join them."""
        return [self._joined(one) for one in self._targets if not self._left[one.start]]

    def unlisted(self) -> list[tuple[range, Order]]:
        """Files that were here as `plan` began, and that no process that finished has kept."""
        known = self._records if self._shard is None else {}
        files = [seeds for seeds in _seeds_in(self._episodes) if file_name(seeds) not in known]
        if self._shard is not None:
            files = [seeds for seeds in files if _is_within(seeds, self._own)]
        return [(seeds, LIST) for seeds in files]

    def order(self, seeds: range) -> Order:
        """Whether some seeds that are played together make a whole file."""
        return FILE if _range_with(seeds.start, self._targets) == seeds else PART

    def add(self, seeds: range, content: bytes) -> list[tuple[range, Order]]:
        """Writes episodes that `plan` has named; returns a file that can be joined now, if any.

        Raises:
          OSError: the file cannot be written, as on a full disk; nothing is left of it. Or another
            process writes to this folder, where there are no locks.
        """
        self._check_alone()
        return self.took(seeds, self.writing.write(seeds, content, self.order(seeds)))

    def join(self, seeds: range, order: Order) -> None:
        """Joins a file in this process.

        Raises:
          OSError: as of `add`.
          DamagedError: a part is damaged.
        """
        self._check_alone()
        with damage_reported():
            file = self.writing.join(seeds, [*order.named()])
        self.took(seeds, file)

    def took(self, seeds: range, file: File | None) -> list[tuple[range, Order]]:
        """Counts what was written in; returns a file that can be joined now, if any.

        Args:
          seeds: of the episodes.
          file: the entry of a file; None for a part.

        Raises:
          OSError: another process writes to this folder, where there are no locks.
        """
        self._check_alone()
        if file is not None:
            self._made[file.name] = file
            return []
        target = _range_with(seeds.start, self._targets)
        if target is None:  # a shard has some of its seeds
            return []
        self._parts_of[target.start].append(seeds)
        self._left[target.start] -= len(seeds)
        return [] if self._left[target.start] else [self._joined(target)]

    def _joined(self, target: range) -> tuple[range, Order]:
        return target, joining(self._parts_of.pop(target.start))

    @contextlib.contextmanager
    def probed(self) -> Iterator[Writing]:
        """The `Writing` of workers, which find the folder by a file with a random name."""
        mark = "" if self._shard is None else f"{self._shard}-"
        name = f"{_PROBE}{mark}{random_letters()}"
        self.writing.put(PARTS, name, lambda partial: None)
        try:
            yield dataclasses.replace(self.writing, probe=name)
        finally:
            (self._parts / name).unlink(missing_ok=True)

    def finish(self) -> None:
        """Writes the manifest and the card, or what a shard knows, if they are others than before.

        Raises:
          DamagedError: a file is damaged or of another dataset.
          OSError: one cannot be read or written.
        """
        self._remove_unfinished()  # of workers that were lost
        with damage_reported():
            if self._shard is None:
                self._write_manifest()
            else:
                self._write_record()

    def _write_manifest(self) -> None:
        """Writes the manifest and the card, and removes what they replace."""
        files = [self._file(seeds) for seeds in self._finished()]
        before = [] if self._manifest is None else self._manifest.wanted
        wanted = united([*before, *self._wanted, *(file.seeds for file in files)])
        manifest = Manifest(self._recipe, wanted, files)
        if manifest != self._manifest or not exists(self.directory / CARD):
            figures = [self._opened(self._episodes / file.name).figures() for file in files]
            write_card(self.directory, manifest, figures)
            self._write(self.directory / MANIFEST, manifest.text(figures))
        for path in named(self._parts, _RECORDS):
            path.unlink(missing_ok=True)
        self._remove_useless(_seeds_in(self._parts, ENDING), united(one.seeds for one in files))
        with contextlib.suppress(OSError):  # it has other files
            self._parts.rmdir()

    def _write_record(self) -> None:
        """Writes the list of a shard's files."""
        own = [seeds for seeds in self._finished() if _is_within(seeds, self._own)]
        path = self._parts / f"dataset-{self._shard}.json"
        known = Manifest.read(path)
        self._records = {file.name: file for file in known.files} if known else {}
        record = Manifest(self._recipe, self._own, [self._file(seeds) for seeds in own])
        if record != known:
            self.writing.put(
                PARTS, path.name, lambda partial: partial.write_text(record.text(), "utf-8")
            )

    def _finished(self) -> list[range]:
        """The seeds of all files; what other machines wrote may be listed here only later."""
        made = (file.seeds for file in self._made.values())
        return sorted({*_seeds_in(self._episodes), *made}, key=lambda seeds: seeds.start)

    def _file(self, seeds: range) -> File:
        """The entry of a file in the manifest.

        The file is read again if no process that finished has kept it.
        """
        name = file_name(seeds)
        if name in self._made:
            return self._made[name]
        file = self._records.get(name)
        if file is not None and file.nbytes == size_of(self._episodes / name):
            return file
        return listed(self._episodes / name)

    def _write(self, path: Place, text: str) -> bytes:
        """Writes a file that is no file of episodes, and returns its bytes."""
        content = text.encode()
        with filling(path, self.directory) as partial:
            partial.write_bytes(content)
        return content

    def log(self, call: Mapping[str, object]) -> None:
        """Writes a call to run.json, in the place of an entry that began at the same time."""
        is_first = self._logged is None
        earlier = [one for one in _calls(self._run) if one.get("began") != call["began"]]
        text = json.dumps({"calls": [*earlier, call]}, indent=2)
        self._logged = self._write(self._run, f"{text}\n")
        if is_first:
            self._remove_unfinished()

    def _remove_unfinished(self) -> None:
        """Removes unfinished files of a process that was killed; other writers have other seeds."""
        for path in named(self._parts, ".seeds-*"):
            found = _UNFINISHED.fullmatch(path.name)
            if found and _range_with(int(found[1]), self._own) is not None:
                path.unlink(missing_ok=True)
        mark = "" if self._shard is None else f"{self._shard}-"
        own = f"{_PROBE}{mark}{_LETTERS}"  # not those of shards that are running
        for pattern in (own, f".{own}.*.part"):  # also one half written
            for path in named(self._parts, pattern):
                path.unlink(missing_ok=True)

    def _check_alone(self) -> None:
        """Raises OSError if another process has logged a call since, for want of locks."""
        if self._logged is None or not exists(self._run):
            return
        if read(self._run) == self._logged:
            return
        raise OSError(
            f"another process writes to {self.directory}: end one of the two, or choose another "
            "folder"
        )

    def calls(self) -> list[dict[str, object]]:
        """The calls that were logged here, those of shards too; see `calls_in`."""
        return calls_in(self.directory)


def discard_other(directory: Path, recipe: Recipe) -> None:
    """Removes the dataset of a folder if it is one of another recipe; other files stay.

    Raises:
      ValueError: it is damaged, or another process writes there.
      OSError: it cannot be read or removed.
    """
    episodes, parts = directory / EPISODES, directory / PARTS
    shards = [episodes / file_name(seeds) for seeds in _seeds_in(episodes)]
    shards += [parts / file_name(seeds, ENDING) for seeds in _seeds_in(parts, ENDING)]
    if not shards or Shard(shards[0]).recipe.difference(recipe) is None:
        return
    with Hold(directory):
        (directory / MANIFEST).unlink(missing_ok=True)
        card = directory / CARD
        if card.exists() and CARD_LINE.encode() in read_regular(card):
            card.unlink()
        for path in [*shards, *directory.glob(_RUNS), *parts.glob(_RECORDS)]:
            path.unlink(missing_ok=True)
        for folder in (episodes, parts):
            with contextlib.suppress(OSError):  # it is missing, or has other files
                folder.rmdir()


def calls_in(directory: Place) -> list[dict[str, object]]:
    """The calls that were logged in a dataset's folder, those of shards too.

    Raises:
      ValueError: a log is damaged.
      OSError: one cannot be read.
    """
    return [call for path in named(directory, _RUNS) for call in _calls(path)]


def _calls(path: Place) -> list[dict[str, object]]:
    """The calls in a log; none where there is no file.

    Raises:
      ValueError: it is damaged, or has more than calls and so is something else.
    """
    if not exists(path):
        return []
    content = read(path)
    try:
        log = json.loads(content)
        calls = [dict(call) for call in log["calls"]]
    except (KeyError, RecursionError, TypeError, ValueError):
        raise ValueError(f"{path} is damaged: remove it, or choose another folder") from None
    if log.keys() != {"calls"} or not all("began" in call for call in calls):
        raise ValueError(f"{path} is no log of a collection: choose another folder")
    return calls


def _seeds_in(folder: Place, ending: str = "parquet") -> list[range]:
    """The seeds that the names of files in a folder give, in their order."""
    found = (named_seeds(path.name) for path in named(folder, f"seeds-*.{ending}"))
    return [seeds for seeds in found if seeds is not None]


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


def _meeting(seeds: range, ranges: Sequence[range]) -> Iterator[range]:
    """Those of increasing ranges that have some of the seeds."""
    number = bisect.bisect_right(ranges, seeds.start, key=lambda one: one.stop)
    while number < len(ranges) and ranges[number].start < seeds.stop:
        yield ranges[number]
        number += 1


def _size(nbytes: float) -> str:
    return f"{nbytes / 1e9:.3g} GB" if nbytes >= 1e9 else f"{nbytes / 1e6:.3g} MB"
