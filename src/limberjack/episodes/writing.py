"""`Writing`: files of episodes as a process writes them: a worker, where it sees the folder.

    writing = Writing(folder, recipe)
    writing.write(range(0, 64), content, FILE)              # a `File`, as the manifest lists it
    writing.write(range(0, 64), content, PART)
    writing.join(range(0, 140), (range(0, 64), range(64, 140)))

    unit = Unit(setup, range(0, 64), (FILE,))
    workers.results(functools.partial(work, writing), [unit])

A file is written whole or not at all, and its bytes depend on the recipe and its seeds alone: a
unit may be played twice, also by two processes at once. A worker first looks for a file with a
random name, the probe. Where it is missing, the worker sees another folder or none, and returns the
bytes.
"""

import contextlib
import dataclasses
import errno
import hashlib
import socket
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal, TypeVar

from limberjack.episodes.episode import Episode
from limberjack.episodes.manifest import EPISODES, PARTS, File, check_name, file_name, sha256_of
from limberjack.episodes.parquet import PYARROW, Shard, encode, join
from limberjack.episodes.places import (
    Place,
    exists,
    filling,
    size_of,
)
from limberjack.episodes.player import play_unit
from limberjack.episodes.recipe import Recipe
from limberjack.workers import Setup

__all__ = [
    "ENDING",
    "FILE",
    "LIST",
    "PART",
    "Order",
    "Unseen",
    "Writing",
    "file_of",
    "joining",
    "listed",
    "work",
]

ENDING = "part"  # of unfinished files, so that no reader of Parquet files takes them

_TRIES = 10  # writes of a file, whose folder another process may remove in between
_Filled = TypeVar("_Filled")
_READ_ONLY = (errno.EACCES, errno.EPERM, errno.EROFS)


@dataclasses.dataclass(frozen=True)
class Order:
    """A piece of work on seeds.

    Attributes:
      what: play them and write them as a file or as a part of one, join parts to a file, or read a
        file for its entry of the manifest.
      parts: to be joined, as (first seed, end, seeds of each): a million of them take a few bytes.
    """

    what: Literal["file", "part", "join", "list"]
    parts: tuple[tuple[int, int, int], ...] = ()

    def named(self) -> Iterator[range]:
        """The seeds of each part."""
        for first, end, size in self.parts:
            for start in range(first, end, size):
                yield range(start, start + size)


FILE, PART, LIST = Order("file"), Order("part"), Order("list")


def joining(parts: Iterable[range]) -> Order:
    """The order to join parts that have all seeds of a file."""
    runs: list[tuple[int, int, int]] = []
    reached = -1
    for part in sorted(parts, key=lambda one: (one.start, -one.stop)):
        if part.stop <= reached:  # others have its episodes
            continue
        reached = part.stop
        if runs and runs[-1][1:] == (part.start, len(part)):
            runs[-1] = (runs[-1][0], part.stop, len(part))
        else:
            runs.append((part.start, part.stop, len(part)))
    return Order("join", tuple(runs))


@dataclasses.dataclass(frozen=True)
class Unseen:
    """The answer of a worker that does not see the folder, or may not write to it.

    Attributes:
      node: the worker's.
      content: of the file of the episodes; None if it was to read files.
    """

    node: str
    content: bytes | None = None


@dataclasses.dataclass(frozen=True)
class Writing:
    """See the module's docstring.

    Attributes:
      folder: of the dataset.
      recipe: of its episodes.
      probe: the name of a file in `parts`; None in the process that plans.
    """

    folder: Place
    recipe: Recipe
    probe: str | None = None

    def is_seen(self) -> bool:
        """Whether this process sees the folder."""
        if self.probe is None:
            return True
        try:
            return exists(self.folder / PARTS / self.probe)
        except OSError:  # a server that this node does not reach
            return False

    def write(self, seeds: range, content: bytes, order: Order) -> File | None:
        """Writes the content of a file or of a part; returns the entry of a file.

        Raises:
          OSError: it cannot be written, as on a full disk; nothing is left of it.
        """
        if order == PART:
            name = file_name(seeds, ENDING)
            self.put(PARTS, name, lambda partial: partial.write_bytes(content))
            return None

        def fill(partial: Path) -> File:
            partial.write_bytes(content)
            digest = hashlib.sha256(content).hexdigest()
            return File(seeds, Shard(partial).rows, len(content), digest)

        return self.put(EPISODES, file_name(seeds), fill)

    def join(self, seeds: range, parts: Sequence[range]) -> File:
        """Joins parts to a file, and removes those that have no other seeds; returns its entry.

        Raises:
          OSError: the file cannot be written, or a part is missing.
          ValueError: a part is damaged.
        """
        path = self.folder / EPISODES / file_name(seeds)
        if exists(path):  # by a worker that was lost before its answer arrived
            file = file_of(path)
        else:
            places = [self.folder / PARTS / file_name(part, ENDING) for part in parts]

            def fill(partial: Path) -> File:
                join(self.recipe, seeds, map(Shard, places), partial)
                return file_of(partial)

            file = self.put(EPISODES, file_name(seeds), fill)
        for part in parts:
            if seeds.start <= part.start and part.stop <= seeds.stop:
                (self.folder / PARTS / file_name(part, ENDING)).unlink(missing_ok=True)
        return file

    def put(self, folder: str, name: str, fill: Callable[[Path], _Filled]) -> _Filled:
        """Writes a file, also while another process removes the folder of parts, empty to it."""
        for left in reversed(range(_TRIES)):
            for one in (PARTS, folder):
                (self.folder / one).mkdir(parents=True, exist_ok=True)
            try:
                with filling(self.folder / folder / name, self.folder / PARTS) as partial:
                    filled = fill(partial)
                return filled
            except FileNotFoundError:
                if not left:
                    raise
        raise AssertionError(name)


def work(writing: Writing, setup: Setup, seeds: range, order: Order) -> File | Unseen | None:
    """Does what is ordered, in a worker; returns the entry of a file that is complete."""
    is_seen = writing.is_seen()
    if order.what in ("file", "part"):
        content = _content(writing.recipe, play_unit(setup, seeds, writing.recipe.kept))
        if is_seen:
            with _read_only_ignored():
                return writing.write(seeds, content, order)
        return Unseen(socket.gethostname(), content)
    if is_seen:
        with _read_only_ignored():
            if order == LIST:
                return listed(writing.folder / EPISODES / file_name(seeds))
            return writing.join(seeds, [*order.named()])
    return Unseen(socket.gethostname())


@contextlib.contextmanager
def _read_only_ignored() -> Iterator[None]:
    """Suppresses the error of a folder that this process may not write to."""
    try:
        yield
    except OSError as error:
        if error.errno not in _READ_ONLY:
            raise


def _content(recipe: Recipe, episodes: Iterable[Episode]) -> bytes:
    """The content of the file of some episodes, as a worker makes it."""
    if recipe.facts["versions"]["pyarrow"] != PYARROW:
        raise ValueError(
            f"pyarrow is {PYARROW} in a worker, and {recipe.facts['versions']['pyarrow']} where "
            "the files are written: install the same version, so that the bytes are equal"
        )
    return encode(recipe, sorted(episodes, key=lambda episode: episode.seed))


def listed(path: Place) -> File:
    """The entry of a complete file; raises also a ValueError if it has another one's episodes."""
    file = file_of(path)
    check_name(path, file.seeds)
    return file


def file_of(path: Place) -> File:
    """The entry of a file in the manifest.

    Raises:
      OSError: it cannot be read.
      ValueError: it is damaged.
    """
    shard = Shard(path)
    return File(shard.seeds, shard.rows, size_of(path), sha256_of(path))
