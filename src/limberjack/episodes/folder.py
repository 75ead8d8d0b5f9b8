"""`Folder`: the files of a dataset, to which a collection adds.

    with Folder(Path("data"), recipe) as folder:
        for seeds in blocks(folder.plan(range(1000))):      # each within one block of 64
            folder.add(seeds, content)

A file has up to 64 episodes, those of one block of seeds, and is named by its seeds. It is written
under a temporary name, and is complete once it has its own. Episodes that take long come one at a
time: they wait in `parts` until their file is complete. `run.json` has what the files must not
depend on: times, hosts, numbers of workers.
"""

import contextlib
import itertools
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from limberjack.episodes.parquet import Shard, join
from limberjack.episodes.recipe import SHARD, Recipe
from limberjack.report import Facts
from limberjack.utils.files import Hold, replacing
from limberjack.utils.regular import read_regular

__all__ = ["Folder", "blocks", "shards_in"]

_PARTS = "parts"
_PATTERN = "seeds-*.parquet"
_RUNS = "run*.json"
_PARTIAL = f".{_PATTERN}"  # unfinished files, among others: see `utils.files.Partial`
_UNFINISHED = re.compile(r"\.seeds-(\d{10})-\d{10}\.[0-9a-f]+\.parquet")
_TRIES = 10  # writes of a part, whose folder another shard may remove in between


def shards_in(directory: Path) -> list[Shard]:
    """The files of a dataset, in the order of their seeds.

    Raises:
      OSError: a file cannot be read.
      ValueError: a file is damaged, is of another recipe than the others, or has seeds of another.
    """
    shards = [Shard(path) for path in sorted(directory.glob(_PATTERN))]
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
    return shards


def blocks(seeds: Iterable[int]) -> Iterator[range]:
    """The seeds, which are increasing, as ranges that each lie within one block of 64."""
    first = last = None
    for seed in seeds:
        if first is None or last is None:
            first = seed
        elif seed != last + 1 or seed % SHARD == 0:
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
          directory: of the files.
          recipe: of the episodes to be added.
          shard: (k, n) of one of n processes that write here, each its own seeds; None if this
            one is alone.

        Raises:
          ValueError: its files have another recipe or are damaged, or another process writes here;
            nothing was changed.
          OSError: a file cannot be read.
        """
        self.directory = directory
        self._parts_folder = directory / _PARTS
        self._recipe = recipe
        self._run = directory / (
            "run.json" if shard is None else "run-{}-of-{}.json".format(*shard)
        )
        directory.mkdir(parents=True, exist_ok=True)
        self._hold = Hold(directory if shard is None else self._run)
        try:
            self._shards = self._checked(shards_in(directory))
            parts = self._checked(_present(sorted(self._parts_folder.glob(_PATTERN))))
            self._parts = {part.seeds.start: part for part in parts}
            self.calls()
        except BaseException:
            self._hold.release()
            raise
        self._targets: list[range] = []
        self._logged: bytes | None = None  # the content of run.json, once this process wrote it

    def __enter__(self) -> "Folder":
        return self

    def __exit__(self, *error: object) -> None:
        self._hold.release()

    def plan(self, seeds: Iterable[int]) -> list[int]:
        """The seeds, of those given, whose episodes are not here; their files will be written.

        Raises:
          ValueError: the episodes may not fit onto the disk; nothing was changed.
        """
        there = {seed for shard in self._shards for seed in shard.seeds}
        self._targets = list(blocks(seed for seed in seeds if seed not in there))
        missing = [s for target in self._targets for s in target if s not in self._parts]
        needed = self._recipe.most_nbytes(len(missing), len(self._targets))
        free = shutil.disk_usage(self.directory).free
        if needed > free:
            raise ValueError(
                f"{len(missing)} episodes may take {_size(needed)}, and {self.directory} has "
                f"{_size(free)} left: give fewer seeds, another folder, or keep less of each step"
            )
        self._join()
        return missing

    def add(self, seeds: range, content: bytes) -> None:
        """Writes episodes that `plan` has named: a whole file, or a part of one.

        Raises:
          OSError: the file cannot be written, as on a full disk; nothing is left of it. Or another
            process writes to this folder, where there are no locks.
        """
        self._check_alone()
        if seeds in self._targets:
            self._write(self.directory / _name(seeds), content)
            self._targets.remove(seeds)
            return
        path = self._parts_folder / _name(seeds)
        self._write_part(path, content)
        self._parts[seeds.start] = Shard(path)
        self._join()

    def _join(self) -> None:
        """Writes the files whose parts are all here, and removes these parts."""
        for target in list(self._targets):
            parts = [self._parts[seed] for seed in target if seed in self._parts]
            if sum(len(part.seeds) for part in parts) < len(target):
                continue
            self._write(self.directory / _name(target), join(parts))
            self._targets.remove(target)
            for part in parts:
                del self._parts[part.seeds.start]
                part.path.unlink()
        with contextlib.suppress(OSError):  # it is missing, or has parts
            self._parts_folder.rmdir()

    def _write_part(self, path: Path, content: bytes) -> None:
        """Writes a part, also while another shard removes the folder, which is empty to it."""
        for _ in range(_TRIES):
            self._parts_folder.mkdir(exist_ok=True)
            with contextlib.suppress(FileNotFoundError):
                self._write(path, content)
                return
        self._write(path, content)

    def _write(self, path: Path, content: bytes) -> None:
        try:
            with replacing(path) as partial:
                partial.write_bytes(content)
        except FileNotFoundError:  # another process that began here has removed it as unfinished
            self._check_alone()
            raise

    def log(self, call: Facts) -> None:
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
        for path in [*self.directory.glob(_PARTIAL), *self._parts_folder.glob(_PARTIAL)]:
            found = _UNFINISHED.fullmatch(path.name)
            if found and any(int(found[1]) in target for target in self._targets):
                path.unlink(missing_ok=True)
        self._join()

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
        """The calls that were logged here, those of shards too.

        Raises:
          ValueError: a log is damaged.
        """
        return [call for path in sorted(self.directory.glob(_RUNS)) for call in _calls(path)]

    def _checked(self, shards: list[Shard]) -> list[Shard]:
        for shard in shards:
            difference = shard.recipe.difference(self._recipe)
            if difference is not None:
                raise ValueError(
                    f"{shard.path} belongs to another dataset than the one asked for, whose "
                    f"{difference}: choose another folder"
                )
        return shards


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


def _present(paths: Iterable[Path]) -> list[Shard]:
    """The files that are still there: another shard may join its parts and remove them."""
    shards = []
    for path in paths:
        with contextlib.suppress(FileNotFoundError):
            shards.append(Shard(path))
    return shards


def _name(seeds: range) -> str:
    """Names that have the order of the seeds."""
    return f"seeds-{seeds.start:010}-{seeds.stop:010}.parquet"


def _size(nbytes: float) -> str:
    return f"{nbytes / 1e9:.3g} GB" if nbytes >= 1e9 else f"{nbytes / 1e6:.3g} MB"
