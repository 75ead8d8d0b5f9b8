"""Small datasets, and what the tests of several modules do with them."""

import dataclasses
import functools
import hashlib
import io
import shutil
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from limberjack import suite
from limberjack.episodes.dataset import Dataset
from limberjack.episodes.episode import Episode, Kept
from limberjack.episodes.parquet import PYARROW, Shard
from limberjack.episodes.player import play_unit
from limberjack.episodes.recipe import Recipe, recipe_of
from limberjack.workers import prepare

__all__ = [
    "ARM",
    "EVERYTHING",
    "PENDULUM",
    "assert_equal",
    "copy",
    "damaged",
    "folder_of",
    "hashes",
    "made",
    "of_64",
    "path_of",
    "put",
    "recipe_for",
    "whole_hashes",
]

PENDULUM = ("pendulum", "swingup", 0.2)  # 10 steps; neither kinds of starts nor model fields
ARM = ("manipulator", "bring_ball", 0.05)  # 5 steps; kinds of starts, and two model fields
EVERYTHING = Kept(states=True, float32=True, flat=True)

_Task = tuple[str, str, float]


def made(
    where: _Task, seeds: range, kept: Kept | None = None, policy: str = "random"
) -> tuple[Recipe, list[Episode]]:
    """The recipe and the episodes of a policy."""
    domain, task, seconds = where
    kept = kept or Kept()
    setup = prepare(domain, task, policy, time_limit=seconds, num_threads=1)
    played = play_unit(setup, seeds, kept)
    return recipe_for(where, kept, policy), sorted(played, key=lambda episode: episode.seed)


def recipe_for(where: _Task, kept: Kept, policy: str = "random") -> Recipe:
    """The recipe of a policy's episodes."""
    domain, task, seconds = where
    setup = prepare(domain, task, policy, time_limit=seconds)
    environment = suite.load(domain, task, {"random": 0, "time_limit": seconds})
    versions = {**setup.identity["versions"], "pyarrow": PYARROW}
    return recipe_of({**setup.identity, "versions": versions}, environment, kept)


@functools.cache
def of_64(where: _Task, kept: Kept = Kept()) -> float:  # noqa: B008 (it cannot change)
    """The megabytes that give a file 64 episodes."""
    recipe = recipe_for(where, kept)
    megabytes = 64.5 * recipe._most_each / 1e6
    assert dataclasses.replace(recipe, file_mb=megabytes).block == 64
    return megabytes


def path_of(shard: Shard) -> Path:
    """The path of a file on this machine."""
    assert isinstance(shard.path, Path)
    return shard.path


def folder_of(dataset: Dataset) -> Path:
    """The folder of a dataset on this machine."""
    return path_of(dataset.shards[0]).parents[1]


def put(folder: Path, name: str, content: bytes) -> Path:
    """Writes a file of episodes into a dataset's folder, as one without a manifest."""
    path = folder / "episodes" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    return path


def damaged(content: bytes) -> bytes:
    """The content of a file in whose first rewards a bit has changed."""
    group = pq.ParquetFile(io.BytesIO(content)).metadata.row_group(0)
    columns = [group.column(number) for number in range(group.num_columns)]
    (rewards,) = (one for one in columns if one.path_in_schema == "reward")
    changed = bytearray(content)
    changed[rewards.data_page_offset + rewards.total_compressed_size - 1] ^= 1
    return bytes(changed)


def copy(folder: Path, out: Path) -> Path:
    """A copy of a dataset."""
    return Path(shutil.copytree(folder, out, dirs_exist_ok=True))


def hashes(folder: Path) -> dict[str, str]:
    """The SHA-256 of each file of episodes of a dataset, by name."""
    paths = sorted(folder.glob("episodes/*"))
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def whole_hashes(folder: Path) -> dict[str, str]:
    """The same, and of the files that depend on the recipe and the seeds alone, too."""
    paths = [folder / "dataset.json", folder / "README.md"]
    others = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
    assert sorted(path.name for path in folder.iterdir() if not path.match("run*.json")) == [
        "README.md", "dataset.json", "episodes",
    ]  # fmt: skip
    return {**hashes(folder), **others}


def assert_equal(one: Episode, other: Episode) -> None:
    """Compares every bit of two episodes."""
    for field in dataclasses.fields(Episode):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(ours, dict):
            assert list(ours) == list(theirs)
            for name in ours:
                _assert_same(ours[name], theirs[name], name)
        else:
            _assert_same(ours, theirs, field.name)


def _assert_same(one: object, other: object, name: str) -> None:
    if not isinstance(one, np.ndarray):
        assert one == other, name
        return
    assert isinstance(other, np.ndarray), name
    assert (one.dtype, one.shape) == (other.dtype, other.shape), name
    assert one.tobytes() == other.tobytes(), name
