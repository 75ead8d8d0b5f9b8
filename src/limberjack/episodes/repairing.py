"""`set_aside`: moves the damaged files of a dataset into its folder `damaged`.

    seeds = set_aside(Path("walk"), recipe)     # of the episodes to be collected again

Every page of every file is read. A file is damaged if it cannot be read, if it has other episodes
than its name says, or if the manifest lists another SHA-256. So is a manifest, or a list of a
shard's files, that cannot be read, and a manifest with other returns than the files. What is moved
keeps its name, and nothing is removed.
"""

import contextlib
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path

from limberjack.episodes.manifest import (
    EPISODES,
    MANIFEST,
    PARTS,
    SET_ASIDE,
    DamagedError,
    File,
    Manifest,
    check_recipe,
    named_seeds,
    sha256_of,
)
from limberjack.episodes.parquet import Shard
from limberjack.episodes.places import Place, exists, named
from limberjack.episodes.recipe import Recipe
from limberjack.episodes.writing import ENDING
from limberjack.utils.files import Hold
from limberjack.utils.log import log

__all__ = ["set_aside"]

_DAMAGED = "damaged"  # the folder to which files are moved


def set_aside(directory: Place, recipe: Recipe) -> list[int]:
    """The seeds of episodes in files that were damaged, and are now in the folder `damaged`.

    Args:
      directory: of the dataset; it need not exist.
      recipe: of its episodes.

    Raises:
      ValueError: a file is of another dataset, or another process writes to the folder; nothing was
        moved.
      OSError: a file cannot be read or moved.
    """
    if not exists(directory):
        return []
    with Hold(directory) if isinstance(directory, Path) else contextlib.nullcontext():
        paths = [*_damaged_lists(directory, recipe), *_damaged_files(directory, recipe)]
        for path in paths:
            to = _free(directory / _DAMAGED, path.name)
            (directory / _DAMAGED).mkdir(exist_ok=True)
            path.rename(to)  # pyright: ignore[reportArgumentType] (both are of one kind)
            log.warning(SET_ASIDE, path, to)
    ranges = (named_seeds(path.name) for path in paths)
    return sorted({seed for seeds in ranges if seeds is not None for seed in seeds})


def _damaged_lists(directory: Place, recipe: Recipe) -> Iterator[Place]:
    """Manifests that cannot be read or are wrong; raises ValueError for one of another dataset."""
    for path in (directory / MANIFEST, *named(directory / PARTS, "dataset-*.json")):
        try:
            manifest = Manifest.read(path)
        except ValueError:
            yield path
            continue
        if manifest is None:
            continue
        check_recipe(path, manifest.recipe, recipe)
        if path.name == MANIFEST and _is_wrong(path, manifest, directory / EPISODES):
            yield path


def _is_wrong(path: Place, manifest: Manifest, episodes: Place) -> bool:
    """Whether a manifest says something else of the episodes than their files, if all are there."""
    try:
        shards = [Shard(episodes / file.name) for file in manifest.files]
        figures = [shard.figures() for shard in shards]
    except (OSError, ValueError):  # a file of episodes is the damaged one
        return False
    try:
        manifest.check(path, figures)
    except DamagedError:
        return True
    return any(file.rows != one.rows for file, one in zip(manifest.files, shards, strict=True))


def _damaged_files(directory: Place, recipe: Recipe) -> Iterator[Place]:
    """Files of episodes, and parts, that are damaged."""
    listed: dict[str, File] = {}
    with contextlib.suppress(ValueError):  # it is damaged, too
        manifest = Manifest.read(directory / MANIFEST)
        listed = {file.name: file for file in manifest.files} if manifest else {}
    files = named(directory / EPISODES, "seeds-*.parquet")
    for path in itertools.chain(files, named(directory / PARTS, f"seeds-*.{ENDING}")):
        if named_seeds(path.name) is not None and _is_damaged(path, recipe, listed):
            yield path


def _is_damaged(path: Place, recipe: Recipe, listed: Mapping[str, File]) -> bool:
    """Whether a file is damaged; raises ValueError if it is whole, and of another dataset."""
    try:
        shard = Shard(path)
        shard.figures()
        for _ in shard.episodes():
            pass
    except ValueError:
        return True
    check_recipe(path, shard.recipe, recipe)
    if named_seeds(path.name) != shard.seeds:
        return True
    return path.name in listed and listed[path.name].sha256 != sha256_of(path)


def _free(folder: Place, name: str) -> Place:
    """A path for a name that is not taken yet."""
    names = itertools.chain([name], (f"{name}.{number}" for number in itertools.count(2)))
    return next(folder / one for one in names if not exists(folder / one))
