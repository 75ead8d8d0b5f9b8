"""`load`: the `Dataset` in a folder or at a URL, whose files are those that its manifest lists.

    dataset = load("data")                      # every file is there
    dataset = load("s3://bucket/data")          # any URL of fsspec
    dataset = load("data", allow_gaps=True)     # those that are there; `dataset.gaps` lists seeds

Only the manifest and footers are read.
"""

import contextlib
import itertools
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

from limberjack.episodes.dataset import Dataset
from limberjack.episodes.episode import Episode
from limberjack.episodes.folder import calls_in, check_distinct
from limberjack.episodes.manifest import EPISODES, MANIFEST, PARTS, File, Manifest, united, without
from limberjack.episodes.parquet import Shard
from limberjack.episodes.places import Place, exists, named, place_of, size_of
from limberjack.episodes.recipe import Recipe
from limberjack.episodes.writing import ENDING

__all__ = ["episodes_so_far", "load"]

_LONGEST = 1000  # characters of a command that is repeated in a message
_OUT = re.compile(r"( --out[= ])('(?:[^']|'\"'\"')*'|\S+)")  # as `shlex.quote` writes names


def load(directory: Path | str, *, allow_gaps: bool = False) -> Dataset:
    """The dataset in a folder.

    Args:
      directory: of the dataset, of this format or of format 1; or its URL, such as
        `https://host/walk`, which is read in place. A server that lists no folders needs a
        manifest, and files that it does not list go unnoticed.
      allow_gaps: load the files that are there and are those of the manifest, or all if there is
        no manifest yet; `Dataset.gaps` lists the seeds that are missing.

    Raises:
      OSError: the folder or a file cannot be read, or a server does not answer.
      ValueError: there is no dataset, a file is damaged or belongs to another one, or two files
        have an episode of one seed. Without `allow_gaps`, a file is missing, is not listed in the
        manifest, or has another size, or there is no manifest. Or there is no such protocol.
      ImportError: the extra `data`, or a package that a protocol needs, is missing.
    """
    folder = place_of(directory)
    if isinstance(folder, Path) and not folder.is_dir():
        raise ValueError(f"{folder} is no folder; expected one that `limberjack collect` wrote")
    manifest = Manifest.read(folder / MANIFEST)
    if manifest is not None:
        return _listed(folder, manifest, allow_gaps)
    old = [Shard(path) for path in named(folder, "seeds-*.parquet")]
    shards = old or [Shard(path) for path in named(folder / EPISODES, "*.parquet")]
    if not shards:
        raise ValueError(
            f"{folder} has no complete file of a dataset; expected {EPISODES}/seeds-*.parquet, as "
            "`limberjack collect` writes them"
        )
    check_distinct(shards)
    if not old and not allow_gaps:
        raise _incomplete(folder, f"{folder} has no {MANIFEST} yet")
    for shard in shards:
        if (shard.recipe.format == 1) is not bool(old):
            raise ValueError(f"{shard.path} has format {shard.recipe.format}, unlike its folder")
    return Dataset(shards)


def episodes_so_far(folder: Path) -> Iterator[Episode]:
    """The episodes in a folder whose collection was interrupted, of unfinished files too.

    Damaged files are left out: the next call names them.
    """
    files = named(folder / EPISODES, "*.parquet"), named(folder / PARTS, f"*.{ENDING}")
    for path in itertools.chain(*files):
        with contextlib.suppress(OSError, ValueError):
            yield from Shard(path).episodes()


def _listed(folder: Place, manifest: Manifest, allow_gaps: bool) -> Dataset:
    """The dataset of a manifest, with which its files are compared."""
    shards: list[Shard] = []
    problems: list[str] = []
    for file in manifest.files:
        path = folder / EPISODES / file.name
        if (wrong := _difference(path, file)) is None:
            shards.append(_checked(path, file, manifest.recipe))
        else:
            problems.append(f"{wrong}: remove it if it is there")
    names = {file.name for file in manifest.files}
    extra = [path for path in named(folder / EPISODES, "*") if path.name not in names]
    problems += [f"{path} is not listed in {MANIFEST}" for path in extra]
    if problems and not allow_gaps:  # first, since another file may be no file of episodes
        raise _incomplete(folder, problems[0])
    shards += [Shard(path) for path in extra if path.suffix == ".parquet"]
    shards.sort(key=lambda shard: shard.seeds.start)
    check_distinct(shards)
    gaps = without(manifest.wanted, united(shard.seeds for shard in shards))
    if gaps and not allow_gaps:
        seed = gaps[0].start
        raise _incomplete(
            folder, f"{folder / MANIFEST} lists no file with the episode of seed {seed}"
        )
    if not shards:
        raise ValueError(f"{folder} has none of the files that its {MANIFEST} lists")
    return Dataset(shards, files=manifest.files, gaps=gaps)


def _difference(path: Place, file: File) -> str | None:
    """A sentence on the size of a file that is not the listed one."""
    if not exists(path):
        return f"{path} is missing, which {MANIFEST} lists"
    size = size_of(path)
    return (
        None
        if size == file.nbytes
        else (f"{path} has {size} bytes, and {file.nbytes} in {MANIFEST}")
    )


def _checked(path: Place, file: File, recipe: Recipe) -> Shard:
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


def _incomplete(folder: Place, problem: str) -> ValueError:
    return ValueError(
        f"{problem}; to finish the dataset, repeat {_command(folder)}; load(..., allow_gaps=True) "
        "gives the episodes that are there"
    )


def _command(folder: Place) -> str:
    """The command that finishes a dataset, as far as its log has it."""
    calls = calls_in(folder) if isinstance(folder, Path) else []
    command = calls[-1].get("command") if calls else None
    if not isinstance(command, str) or not 0 < len(command) < _LONGEST:
        return "the call that collected it"
    command = re.sub(r" --shard[= ][^ ]+", "", command)
    here = shlex.quote(str(folder))  # which may be a copy
    return f"`{re.sub(_OUT, lambda out: f'{out[1]}{here}', command)}`"
