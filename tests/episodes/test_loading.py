"""Datasets are loaded if their files are those of the manifest."""

import dataclasses
import hashlib
import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.data import Dataset, collect, inform, load, replay
from limberjack.episodes.loading import episodes_so_far
from limberjack.episodes.parquet import Shard, encode

from .collected import PENDULUM, copy, folder_of, hashes, made, path_of, put

_FORMAT_1 = Path(__file__).parent / "format1"


def test_a_folder_without_a_dataset_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="has no complete file of a dataset"):
        load(tmp_path)
    with pytest.raises(ValueError, match="is no folder; expected one that"):
        load(tmp_path / "missing")


@pytest.fixture
def folder(pendulums: Dataset, tmp_path: Path) -> Path:
    """A copy of a dataset of two files, of seeds 0 to 63 and 64 to 69."""
    return copy(folder_of(pendulums), tmp_path / "copy")


def test_the_episodes_so_far_are_those_of_whole_files_and_parts(folder: Path) -> None:
    (folder / "parts").mkdir()
    (folder / "episodes" / _SECOND).rename(folder / "parts" / f"{_SECOND[:-7]}part")
    (folder / "episodes" / _FIRST).write_bytes(b"damaged")
    assert [episode.seed for episode in episodes_so_far(folder)] == [*range(64, 70)]


_FIRST, _SECOND = "seeds-0000000000-0000000064.parquet", "seeds-0000000064-0000000070.parquet"


def _remove(episodes: Path) -> None:
    (episodes / _FIRST).unlink()


def _shorten(episodes: Path) -> None:
    (episodes / _FIRST).write_bytes((episodes / _FIRST).read_bytes()[:-1])


def _lengthen(episodes: Path) -> None:
    (episodes / _FIRST).write_bytes((episodes / _FIRST).read_bytes() + b"1")


def _add(episodes: Path) -> None:
    recipe, more = made(PENDULUM, range(70, 72))
    recipe = dataclasses.replace(recipe, file_mb=Shard(episodes / _FIRST).recipe.file_mb)
    put(episodes.parent, "seeds-0000000070-0000000072.parquet", encode(recipe, more))


@pytest.mark.parametrize(
    ("change", "message", "episodes", "gaps"),
    [
        (_remove, f"{_FIRST} is missing, which dataset.json lists", 6, range(64)),
        (_shorten, rf"{_FIRST} has \d+ bytes, and \d+ in dataset.json", 6, range(64)),
        (_lengthen, rf"{_FIRST} has \d+ bytes, and \d+ in dataset.json", 6, range(64)),
        (_add, r"seeds-0000000070-0000000072.parquet is not listed in dataset.json", 72, []),
    ],
)
def test_a_gap_or_another_file_is_refused_or_listed(
    change: Callable[[Path], None], message: str, episodes: int, gaps: range, folder: Path
) -> None:
    change(folder / "episodes")
    with pytest.raises(ValueError, match=message) as caught:
        load(folder)
    assert "the call that collected it" in str(caught.value)
    dataset = load(folder, allow_gaps=True)
    assert len(dataset) == len(list(dataset)) == episodes
    assert dataset.gaps == list(gaps)


def test_the_command_that_finishes_a_dataset_is_named(folder: Path) -> None:
    (folder / "dataset.json").unlink()
    call = {"began": "now", "command": "limberjack collect a b --shard 2/3 --out c"}
    (folder / "run.json").write_text(json.dumps({"calls": [call]}))
    command = re.escape(f"`limberjack collect a b --out {folder}`")
    message = rf"has no dataset.json yet; .* repeat {command}; load"
    with pytest.raises(ValueError, match=message):
        load(folder)
    dataset = load(folder, allow_gaps=True)
    assert (len(dataset), dataset.gaps) == (70, [])
    assert dataset.sha256() == hashes(folder)
    call["command"] = "x" * 10_000
    (folder / "run.json").write_text(json.dumps({"calls": [call]}))
    with pytest.raises(ValueError, match="repeat the call that collected it"):
        load(folder)


def test_the_command_names_the_folder_that_was_loaded(folder: Path) -> None:
    (folder / "dataset.json").unlink()
    log = json.loads((folder / "run.json").read_text())
    for out in ("walk", "'my walk'", "'it'\"'\"'s'"):
        log["calls"][-1]["command"] = f"limberjack collect pendulum swingup --out {out} --seeds 0:2"
        (folder / "run.json").write_text(json.dumps(log))
        command = f"`limberjack collect pendulum swingup --out {folder} --seeds 0:2`"
        with pytest.raises(ValueError, match=re.escape(command)):
            load(folder)


@pytest.mark.parametrize(("name", "error"), [(None, TypeError), (3, TypeError), ("", ValueError)])
def test_what_names_no_folder_is_refused(name: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match="expected a path or a URL"):
        load(name)
    with pytest.raises(error, match="expected a path or a URL"):
        collect("pendulum", "swingup", seeds=range(1), out=name, time_limit=0.1)


def test_a_manifest_of_other_seeds_or_rows_than_the_files_is_refused(folder: Path) -> None:
    path = folder / "dataset.json"
    text = path.read_text()
    path.write_text(text.replace('"rows": 704', '"rows": 703'))
    for allow_gaps in (False, True):
        with pytest.raises(ValueError, match=f"{_FIRST} is not the file that dataset.json lists"):
            load(folder, allow_gaps=allow_gaps)
    path.write_text(text.replace('"policy": "random"', '"policy": "zero"'))
    with pytest.raises(ValueError, match="whose policy is 'random' and 'zero': remove it"):
        load(folder)
    path.write_text(text.replace("[0, 70]", "[0, 80]"))
    with pytest.raises(ValueError, match=r"lists no file with the episode of seed 70; .* repeat"):
        load(folder)
    assert load(folder, allow_gaps=True).gaps == list(range(70, 80))


def test_an_episode_in_two_files_is_refused(folder: Path) -> None:
    recipe, more = made(PENDULUM, range(69, 71))
    recipe = dataclasses.replace(recipe, file_mb=Shard(folder / "episodes" / _FIRST).recipe.file_mb)
    put(folder, "seeds-0000000069-0000000071.parquet", encode(recipe, more))
    with pytest.raises(ValueError, match="both have the episode of seed 69: remove one"):
        load(folder, allow_gaps=True)


@pytest.mark.parametrize("name", ["mine.txt", ".hidden", "seeds-0000000070-0000000072.part"])
def test_a_file_of_something_else_is_refused(name: str, folder: Path) -> None:
    (folder / "episodes" / name).write_text("mine")
    with pytest.raises(ValueError, match=f"{re.escape(name)} is not listed in dataset.json"):
        load(folder)
    assert len(load(folder, allow_gaps=True)) == 70


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
@pytest.mark.parametrize("name", ["dataset.json", f"episodes/{_FIRST}", "episodes/a.parquet"])
def test_a_pipe_in_the_place_of_a_file_is_refused_at_once(name: str, folder: Path) -> None:
    (folder / name).unlink(missing_ok=True)
    os.mkfifo(folder / name)
    message = f"{Path(name).name} (is a pipe|is not listed|has 0 bytes)"
    with pytest.raises(ValueError, match=message):
        load(folder)


def test_as_many_other_files_are_not_compared_with_the_returns_of_all(folder: Path) -> None:
    _add(folder / "episodes")
    _remove(folder / "episodes")
    load(folder, allow_gaps=True).verify()


def test_a_dataset_of_format_1_is_read(tmp_path: Path) -> None:
    dataset = load(_FORMAT_1)
    assert (dataset.recipe.format, dataset.seeds, dataset.steps) == (1, [63, 64], 10)
    episode = dataset.episode(64)
    assert episode.start in ("level_0", "level_1", "level_2")
    assert np.isfinite(episode.actions).all()
    assert episode.actions.shape == (5, 5)
    assert episode.truncated.tolist() == [False] * 4 + [True]
    assert [part.seeds for part in (dataset.part(0, 2), dataset.part(1, 2))] == [[63], [64]]
    information = inform(dataset, verify=True)
    assert information.files == {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(_FORMAT_1.glob("*.parquet"))
    }
    assert sum(map(len, dataset.batches(4))) == 10


def test_a_dataset_of_format_1_is_replayed() -> None:
    # Other versions of MuJoCo and other processors may give other last bits.
    difference = replay(load(_FORMAT_1), num_threads=1)
    gap = re.search(r"differs by up to ([-+.e\d]+)", difference or "differs by up to 0.")
    assert gap is not None, difference
    assert float(gap[1].rstrip(".")) < 1e-9


def test_nothing_is_added_to_a_dataset_of_format_1(tmp_path: Path) -> None:
    folder = copy(_FORMAT_1, tmp_path / "old")
    before = sorted(folder.iterdir())
    with pytest.raises(ValueError, match="a dataset of format 1, to which nothing can be added"):
        collect("stacker", "stack_2", "random", range(63, 66), out=folder, time_limit=0.05)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize("old", [True, False])
def test_a_file_in_a_folder_of_another_format_is_refused(
    old: bool, pendulums: Dataset, tmp_path: Path
) -> None:
    source = path_of(pendulums.shards[0]) if old else next(_FORMAT_1.glob("*.parquet"))
    if old:
        (tmp_path / source.name).write_bytes(source.read_bytes())
    else:
        put(tmp_path, source.name, source.read_bytes())
    with pytest.raises(ValueError, match=f"has format {2 if old else 1}, unlike its folder"):
        load(tmp_path, allow_gaps=True)
