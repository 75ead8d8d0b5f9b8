"""`Manifest`: the file dataset.json of a dataset, which says what its folder must hold.

    manifest = Manifest(recipe, wanted=[range(0, 640)], files=[...])
    text = manifest.text(figures)
    manifest = Manifest.read(Path("walk"))      # None where there is no such file

It depends on the recipe and the seeds alone, as the files do. The file may come from anyone, and is
checked: a name that it lists is that of the seeds beside it, never another path.
"""

import contextlib
import dataclasses
import hashlib
import itertools
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from limberjack.episodes.figures import Figures
from limberjack.episodes.places import Place, exists, opened
from limberjack.episodes.recipe import FORMAT, Recipe, seeds_of
from limberjack.policies.entries import entry_of

__all__ = [
    "EPISODES",
    "MANIFEST",
    "NOT_DRAWN",
    "PARTS",
    "REPAIR",
    "SET_ASIDE",
    "DamagedError",
    "File",
    "Manifest",
    "check_name",
    "check_recipe",
    "damage_reported",
    "file_name",
    "in_lines",
    "named_seeds",
    "sha256_of",
    "united",
    "without",
]

MANIFEST, EPISODES, PARTS = "dataset.json", "episodes", "parts"
# What is logged by a repair, and where the median episode cannot be drawn.
SET_ASIDE = "%s is damaged: it was moved to %s, and is made again"
NOT_DRAWN = "%s is complete, without %s: %s"

# What to do about a damaged file.
REPAIR = "repeat the command that collected it with --repair, which makes it again"
_MOST_BYTES = 2**28  # of a manifest: ten million episodes
_NAME = re.compile(r"seeds-(\d{10})-(\d{10})\.(parquet|part)")
_SHA256 = re.compile(r"[0-9a-f]{64}")


class DamagedError(ValueError):
    """A file of a dataset is damaged; the message says what to do about it."""

    would_recur = True  # as of a `WorkError`


def check_name(path: Place, seeds: range) -> None:
    """Raises ValueError unless a file is called after the seeds of its episodes."""
    if named_seeds(path.name) != seeds:
        raise ValueError(
            f"{path} has the episodes of {file_name(seeds)}: give it its name back, or remove it"
        )


def check_recipe(path: Place, recipe: Recipe, expected: Recipe) -> None:
    """Raises ValueError unless a file's recipe is that of the dataset that is asked for."""
    difference = recipe.difference(expected)
    if difference is not None:
        raise ValueError(
            f"{path} belongs to another dataset than the one asked for, whose {difference}: choose "
            "another folder, or give the command that collected it"
        )


@contextlib.contextmanager
def damage_reported() -> Iterator[None]:
    """Turns the ValueError of a damaged file into a `DamagedError`."""
    try:
        yield
    except DamagedError:
        raise
    except ValueError as error:
        raise DamagedError(f"{error}; or {REPAIR}") from error


@dataclasses.dataclass(frozen=True)
class File:
    """A file of episodes, as the manifest lists it."""

    seeds: range
    rows: int
    nbytes: int
    sha256: str

    @property
    def name(self) -> str:
        """The file's name."""
        return file_name(self.seeds)

    def as_json(self, returns: Sequence[float | None]) -> dict[str, object]:
        """The file and the returns of its episodes as values of JSON."""
        return {
            "name": self.name,
            "seeds": [self.seeds.start, self.seeds.stop],
            "rows": self.rows,
            "bytes": self.nbytes,
            "sha256": self.sha256,
            "returns": list(returns),
        }

    @classmethod
    def of_json(cls, entry: object) -> "File":
        """The file of an entry; raises ValueError if it is none."""
        if not isinstance(entry, dict):
            raise ValueError(f"a file is {entry!r}")
        seeds = seeds_of(entry.get("seeds"))
        if entry.get("name") != file_name(seeds):
            raise ValueError(f"a file is named {entry.get('name')!r}; expected {file_name(seeds)}")
        given = [entry.get(name) for name in ("rows", "bytes", "sha256")]
        what = f"the list of rows, bytes and SHA-256 of {file_name(seeds)}"
        rows, nbytes, digest = entry_of(tuple[int, int, str], given, what)
        if not _SHA256.fullmatch(digest):
            raise ValueError(f"{file_name(seeds)} has the SHA-256 {digest!r}")
        return cls(seeds, rows, nbytes, digest)


@dataclasses.dataclass(frozen=True)
class Manifest:
    """See the module's docstring.

    Attributes:
      recipe: of all episodes.
      wanted: the seeds that were asked for, in increasing ranges that do not touch.
      files: in the order of their seeds.
    """

    recipe: Recipe
    wanted: list[range]
    files: list[File]

    def text(self, figures: Sequence[Figures] = ()) -> str:
        """The file's content, with the figures of each file, in their order; none for a shard's."""
        returns = [one.returns_listed() for one in figures] or [[] for _ in self.files]
        files = [file.as_json(of) for file, of in zip(self.files, returns, strict=True)]
        everything = Figures(self.recipe)
        for one in figures:
            everything.include(one)
        content = {
            "format": FORMAT,
            "recipe": self.recipe.as_json(),
            "seeds": [[seeds.start, seeds.stop] for seeds in self.wanted],
            "episodes": sum(len(file.seeds) for file in self.files),
            "steps": sum(file.rows - len(file.seeds) for file in self.files),
            "statistics": everything.statistics(),
            "files": files,
        }
        return in_lines(content)

    def check(self, path: Place, figures: Sequence[Figures]) -> None:
        """Compares what a file says of the episodes with the figures of each file of episodes.

        Raises:
          DamagedError: they differ.
          OSError: it cannot be read.
        """
        with opened(path) as file:
            found = json.loads(file.read(_MOST_BYTES))
        for name, expected in json.loads(self.text(figures)).items():
            if found.get(name) != expected:
                raise DamagedError(f"the {name} in {path} are not those of the episodes: {REPAIR}")

    @classmethod
    def read(cls, path: Place) -> "Manifest | None":
        """The manifest in a file; None if there is no such file.

        Raises:
          OSError: it cannot be read.
          ValueError: it is damaged, or something else.
        """
        if not exists(path):
            return None
        with opened(path) as file:
            content = file.read(_MOST_BYTES + 1)
        try:
            if len(content) > _MOST_BYTES:
                raise ValueError(f"it has more than {_MOST_BYTES:,} bytes")
            return cls._parsed(json.loads(content))
        except (KeyError, RecursionError, TypeError, ValueError) as error:
            reason = "it is nested too deeply" if isinstance(error, RecursionError) else error
            raise ValueError(
                f"{path} is damaged or no list of a dataset's files ({reason}); remove it, and "
                "repeat the command that collected the episodes"
            ) from None

    @classmethod
    def _parsed(cls, content: object) -> "Manifest":
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise ValueError(f"it is not of format {FORMAT}")
        recipe = Recipe.of_json(content["recipe"])
        wanted = [seeds_of(entry) for entry in content["seeds"]]
        files = [File.of_json(entry) for entry in content["files"]]
        if recipe.format != FORMAT:
            raise ValueError(f"its recipe is not of format {FORMAT}")
        for ranges in (wanted, [file.seeds for file in files]):
            if any(b.start < a.stop for a, b in itertools.pairwise(ranges)):
                raise ValueError("its seeds do not increase")
        return cls(recipe, wanted, files)


def in_lines(content: Mapping[str, object]) -> str:
    """JSON with a line for each entry of the entries, such as a file, a column or an episode."""
    lines = [f"{json.dumps(name)}: {_lines(value)}" for name, value in content.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _lines(value: object) -> str:
    if isinstance(value, list) and value:
        return "[\n" + ",\n".join(f" {_line(one)}" for one in value) + "\n]"
    if isinstance(value, dict) and value:
        entries = (f" {json.dumps(name)}: {_line(one)}" for name, one in value.items())
        return "{\n" + ",\n".join(entries) + "\n}"
    return _line(value)


def _line(value: object) -> str:
    return json.dumps(value, allow_nan=False)


def file_name(seeds: range, ending: str = "parquet") -> str:
    """The name of the file of some seeds; names have the order of the seeds."""
    return f"seeds-{seeds.start:010}-{seeds.stop:010}.{ending}"


def named_seeds(name: str) -> range | None:
    """The seeds that the name of a file gives; None for another name."""
    found = _NAME.fullmatch(name)
    seeds = range(int(found[1]), int(found[2])) if found else range(0)
    return seeds if seeds else None


def sha256_of(path: Place) -> str:
    """The SHA-256 of a file, in hex."""
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def united(ranges: Iterable[range]) -> list[range]:
    """The seeds of some ranges in increasing ranges that do not touch."""
    found: list[range] = []
    for one in sorted(ranges, key=lambda one: one.start):
        if found and one.start <= found[-1].stop:
            found[-1] = range(found[-1].start, max(found[-1].stop, one.stop))
            continue
        found.append(one)
    return found


def without(ranges: Sequence[range], others: Sequence[range]) -> list[range]:
    """The seeds of increasing ranges that are in none of others, which increase, too."""
    left, found = list(reversed(others)), []
    for one in ranges:
        first = one.start
        while left and left[-1].start < one.stop:
            if first < left[-1].start:
                found.append(range(first, left[-1].start))
            first = max(first, left[-1].stop)
            if left[-1].stop > one.stop:
                break
            left.pop()
        if first < one.stop:
            found.append(range(first, one.stop))
    return found
