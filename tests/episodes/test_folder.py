"""The folder of a dataset: what is missing, what is written, and what is refused."""

import contextlib
import dataclasses
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pytest

from limberjack.data import load
from limberjack.episodes.folder import Folder, blocks, check_distinct
from limberjack.episodes.manifest import Manifest, sha256_of
from limberjack.episodes.parquet import Shard, encode
from limberjack.episodes.places import filling
from limberjack.episodes.recipe import Recipe
from limberjack.utils import files

from .collected import PENDULUM, hashes, made, of_64, put, whole_hashes

_FIRST, _EPISODES = made(PENDULUM, range(60, 70))
_RECIPE = dataclasses.replace(_FIRST, file_mb=of_64(PENDULUM))
_SMALL = dataclasses.replace(_FIRST, file_mb=of_64(PENDULUM) / 16)  # of 4 episodes
_OTHER = dataclasses.replace(made(PENDULUM, range(1), policy="zero")[0], file_mb=_RECIPE.file_mb)


def _content(first: int, end: int, recipe: Recipe = _RECIPE) -> bytes:
    return encode(recipe, _EPISODES[first - 60 : end - 60])


def _add(folder: Folder, *seeds: range, recipe: Recipe = _RECIPE) -> None:
    """Writes units, and joins what can be joined."""
    for some in seeds:
        for file, order in folder.add(some, _content(some.start, some.stop, recipe)):
            folder.join(file, order)


def _plan(folder: Folder, seeds: Sequence[int], own: Sequence[int] | None = None) -> list[int]:
    """The missing seeds, after what can be joined was joined."""
    missing = folder.plan(seeds, own)
    for file, order in folder.ready():
        folder.join(file, order)
    return missing


def _gather(
    out: Path, seeds: Sequence[int], units: Sequence[range], shard: tuple[int, int] | None = None
) -> None:
    """Collects episodes into small files, played in some units."""
    own = [seed for unit in units for seed in unit]
    with Folder(out, _SMALL, shard) as folder:
        assert _plan(folder, seeds, own if shard else None) == own
        _add(folder, *units, recipe=_SMALL)
        folder.finish()


def test_blocks_are_split_at_multiples_of_64_and_at_gaps() -> None:
    assert list(blocks([], 64)) == []
    assert list(blocks(range(60, 130), 64)) == [range(60, 64), range(64, 128), range(128, 130)]
    assert list(blocks(range(5), 1)) == [range(seed, seed + 1) for seed in range(5)]
    assert list(blocks([1, 2, 5, 63, 64], 64)) == [
        range(1, 3),
        range(5, 6),
        range(63, 64),
        range(64, 65),
    ]


def test_a_whole_file_is_written_at_once(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        assert _plan(folder, range(60, 66)) == list(range(60, 66))
        _add(folder, range(60, 64))
        assert list(hashes(tmp_path)) == ["seeds-0000000060-0000000064.parquet"]
    with Folder(tmp_path, _RECIPE) as folder:
        assert _plan(folder, range(58, 70)) == [58, 59, *range(64, 70)]


def test_parts_are_kept_until_their_file_is_complete(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        _plan(folder, range(60, 63))
        _add(folder, range(61, 62), range(60, 61))
    assert hashes(tmp_path) == {}
    assert sorted(path.suffix for path in (tmp_path / "parts").iterdir()) == [".part"] * 2
    with Folder(tmp_path, _RECIPE) as folder:
        assert _plan(folder, range(60, 63)) == [62]
        _add(folder, range(62, 63))
        folder.finish()
    (path,) = (tmp_path / "episodes").iterdir()
    assert path.read_bytes() == _content(60, 63)
    assert not (tmp_path / "parts").exists()


def test_a_file_is_joined_from_parts_that_are_cut_anywhere(tmp_path: Path) -> None:
    seeds = range(60, 70)  # in files of 60 to 63, 64 to 67, and 68 to 69
    for name, units in {
        "whole": [range(60, 64), range(64, 68), range(68, 70)],
        "single": [range(seed, seed + 1) for seed in seeds],
        "parts": [range(60, 62), range(62, 64), range(64, 65), range(65, 68), range(68, 70)],
    }.items():
        _gather(tmp_path / name, seeds, units)
        assert whole_hashes(tmp_path / name) == whole_hashes(tmp_path / "whole")
    # Parts of calls with fewer seeds, of which one has seeds of two files.
    out = tmp_path / "other"
    with Folder(out, _RECIPE) as folder:
        _plan(folder, range(64, 70))
        _add(folder, range(64, 69))
    with Folder(out, _RECIPE) as folder:
        assert _plan(folder, range(64, 66)) == []
        assert list(hashes(out)) == ["seeds-0000000064-0000000066.parquet"]
        assert _plan(folder, range(64, 70)) == [69]
        _add(folder, range(69, 70))
        folder.finish()
    assert (out / "episodes/seeds-0000000066-0000000070.parquet").read_bytes() == _content(66, 70)
    assert load(out).seeds == list(range(64, 70))
    assert not (out / "parts").exists()


def test_seeds_that_are_added_to_a_block_have_a_file_of_their_own(tmp_path: Path) -> None:
    _gather(tmp_path, range(60, 63), [range(60, 63)])
    before = hashes(tmp_path)
    _gather(tmp_path, range(63, 66), [range(63, 64), range(64, 66)])
    assert before.items() < hashes(tmp_path).items()
    assert list(hashes(tmp_path)) == [
        "seeds-0000000060-0000000063.parquet",
        "seeds-0000000063-0000000064.parquet",
        "seeds-0000000064-0000000066.parquet",
    ]
    assert load(tmp_path).seeds == list(range(60, 66))
    with Folder(tmp_path, _SMALL) as folder:
        assert _plan(folder, range(58, 70)) == [58, 59, 66, 67, 68, 69]


def test_the_manifest_is_written_if_something_has_changed(tmp_path: Path) -> None:
    _gather(tmp_path, range(60, 62), [range(60, 62)])
    times = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    _gather(tmp_path, range(60, 62), [])
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == times
    manifest = Manifest.read(tmp_path / "dataset.json")
    assert manifest is not None
    assert manifest.wanted == [range(60, 62)]
    _gather(tmp_path, [60, 64], [range(64, 65)])
    manifest = Manifest.read(tmp_path / "dataset.json")
    assert manifest is not None
    assert manifest.wanted == [range(60, 62), range(64, 65)]


def test_a_file_that_was_lost_is_a_gap_until_its_seeds_are_collected_again(tmp_path: Path) -> None:
    _gather(tmp_path, range(60, 64), [range(60, 64)])
    before = whole_hashes(tmp_path)
    next((tmp_path / "episodes").iterdir()).unlink()
    _gather(tmp_path, range(64, 66), [range(64, 66)])
    with pytest.raises(ValueError, match="lists no file with the episode of seed 60"):
        load(tmp_path)
    assert load(tmp_path, allow_gaps=True).gaps == [60, 61, 62, 63]
    _gather(tmp_path, range(60, 64), [range(60, 64)])
    assert load(tmp_path).seeds == list(range(60, 66))
    assert before.items() & hashes(tmp_path).items()


def test_shards_in_any_order_leave_the_rest_to_the_process_without_a_shard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seeds, units = range(60, 70), [range(60, 66), range(66, 70)]
    _gather(tmp_path / "one", seeds, [range(60, 64), range(64, 68), range(68, 70)])
    out = tmp_path / "shards"
    for k in (2, 1):
        _gather(out, seeds, [*blocks(units[k - 1], 4)], (k, 2))
        assert (out / "parts" / f"dataset-{k}-of-2.json").exists()
    # The file of seeds 64 to 67 has those of both.
    assert sorted(path.name for path in (out / "parts").glob("*.part")) == [
        "seeds-0000000064-0000000066.part",
        "seeds-0000000066-0000000068.part",
    ]
    assert not (out / "dataset.json").exists()
    hashed: list[int] = []

    def hashing(path: Path) -> str:
        hashed.append(Shard(path).seeds.start)
        return sha256_of(path)

    monkeypatch.setattr("limberjack.episodes.writing.sha256_of", hashing)
    _gather(out, seeds, [])
    assert hashed == [64]  # of the file that was joined: shards have listed the others
    assert whole_hashes(out) == whole_hashes(tmp_path / "one")


def test_a_shard_opens_one_file_of_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for first in (60, 64):
        _gather(tmp_path, range(60, first + 4), [range(first, first + 4)])
    opened: list[str] = []

    def opening(path: Path) -> Shard:
        opened.append(path.name)
        return Shard(path)

    monkeypatch.setattr("limberjack.episodes.folder.Shard", opening)
    _gather(tmp_path, range(60, 70), [range(68, 70)], (3, 3))
    assert opened == ["seeds-0000000060-0000000064.parquet"]


def test_a_shard_that_was_killed_before_its_end_is_made_up_for(tmp_path: Path) -> None:
    seeds, units = range(60, 70), [range(60, 64), range(64, 68), range(68, 70)]
    _gather(tmp_path / "one", seeds, units)
    with Folder(tmp_path / "shards", _SMALL, (1, 2)) as folder:
        _plan(folder, seeds, range(60, 68))
        _add(folder, units[0], recipe=_SMALL)
    _gather(tmp_path / "shards", seeds, units[2:], (2, 2))
    _gather(tmp_path / "shards", seeds, units[1:2])
    assert whole_hashes(tmp_path / "shards") == whole_hashes(tmp_path / "one")


@pytest.mark.parametrize("text", ["", "[]", '{"format": 2}', "[" * 100_000])
def test_damaged_words_of_a_shard_are_refused_by_name(text: str, tmp_path: Path) -> None:
    _gather(tmp_path, range(60, 64), [range(60, 64)], (1, 2))
    path = tmp_path / "parts" / "dataset-1-of-2.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"{path} is damaged or no list of a dataset's files"):
        Folder(tmp_path, _SMALL)


def test_a_file_with_another_name_than_its_seeds_is_refused(tmp_path: Path) -> None:
    path = put(tmp_path, "seeds-0000000060-0000000063.parquet", _content(60, 64))
    with pytest.raises(ValueError, match=f"{path} has the episodes of seeds-0000000060-0000000064"):
        Folder(tmp_path, _RECIPE)


def test_a_file_of_another_name_does_not_enter_the_manifest(tmp_path: Path) -> None:
    put(tmp_path, "seeds-0000000060-0000000063.parquet", _content(60, 63))
    with Folder(tmp_path, _RECIPE) as folder:
        folder.finish()
    before = (tmp_path / "dataset.json").read_bytes()
    path = put(tmp_path, "seeds-0000000063-0000000066.parquet", _content(60, 63))
    message = f"{path} has the episodes of seeds-0000000060-0000000063.*: give it its name back"
    with pytest.raises(ValueError, match=message), Folder(tmp_path, _RECIPE) as folder:
        folder.finish()
    assert (tmp_path / "dataset.json").read_bytes() == before


def test_a_process_that_died_between_parts_and_file_is_made_up_for(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        _plan(folder, range(60, 63))
        _add(folder, range(60, 61), range(61, 62))
    parts = {path: path.read_bytes() for path in (tmp_path / "parts").iterdir()}
    with Folder(tmp_path, _RECIPE) as folder:
        assert _plan(folder, range(60, 62)) == []
    (path,) = (tmp_path / "episodes").iterdir()
    assert path.read_bytes() == _content(60, 62)
    for part, content in parts.items():  # as if it had died before it removed them
        part.write_bytes(content)
    with Folder(tmp_path, _RECIPE) as folder:
        assert _plan(folder, range(60, 62)) == []
        folder.finish()
    assert not (tmp_path / "parts").exists()


def test_files_that_a_killed_process_left_unfinished_are_removed(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    left = [
        tmp_path / "parts" / ".seeds-0000000060-0000000064.77.part",
        tmp_path / "parts" / ".seeds-0000000061-0000000062.77.part",
    ]
    other = tmp_path / "parts" / ".seeds-0000000128-0000000192.78.part"  # of another process, maybe
    for path in (*left, other):
        path.write_bytes(b"PAR1")
    with Folder(tmp_path, _RECIPE) as folder:
        _plan(folder, range(60, 64))
        folder.log({"began": "now"})
    assert list((tmp_path / "parts").iterdir()) == [other]


def test_the_probe_of_workers_is_removed_with_them(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder, folder.probed() as writing:
        assert writing.is_seen()
    assert not writing.is_seen()


@pytest.mark.parametrize("shard", [None, (1, 8)])
def test_only_the_probes_of_the_same_part_are_removed(
    shard: tuple[int, int] | None, tmp_path: Path
) -> None:
    (tmp_path / "parts").mkdir()
    probes = {
        of: tmp_path / "parts" / f".probe-{mark}0123456789abcdef"
        for of, mark in ((None, ""), ((1, 8), "1-of-8-"), ((2, 8), "2-of-8-"))
    }
    for path in probes.values():
        path.touch()
        path.with_name(f".{path.name}.77.part").touch()  # half written
    with Folder(tmp_path, _RECIPE, shard) as folder:
        _plan(folder, range(60, 64), range(60, 64))
        folder.log({"began": "now"})
    removed = probes.pop(shard)
    assert not removed.exists()
    assert not removed.with_name(f".{removed.name}.77.part").exists()
    for path in probes.values():
        assert path.exists()
        assert path.with_name(f".{path.name}.77.part").exists()


@pytest.mark.parametrize("shard", [None, (1, 1)])
def test_files_that_a_lost_worker_left_unfinished_are_removed_in_the_end(
    shard: tuple[int, int] | None, tmp_path: Path
) -> None:
    with Folder(tmp_path, _RECIPE, shard) as folder:
        _plan(folder, range(60, 64), range(60, 64))
        folder.log({"began": "now"})
        left = tmp_path / "parts" / ".seeds-0000000060-0000000064.77.part"
        left.parent.mkdir(exist_ok=True)
        left.write_bytes(b"PAR1")
        _add(folder, range(60, 64))
        folder.finish()
    assert not left.exists()


def test_a_dataset_that_may_not_fit_is_refused_before_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Usage(NamedTuple):
        free: int

    needed = _RECIPE.most_nbytes(episodes=6, files=2)  # with a file that is joined from parts
    with Folder(tmp_path, _RECIPE) as folder:
        monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(needed - 1))
        with pytest.raises(ValueError, match=r"3 episodes may take .* MB, and .* has .* MB left: "):
            _plan(folder, range(3))
        monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(needed))
        assert _plan(folder, range(3)) == [0, 1, 2]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("parts", [False, True])
def test_a_folder_with_another_dataset_is_refused_by_name(parts: bool, tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        _plan(folder, range(60, 62))
        _add(folder, range(60, 61 if parts else 62))
    for _ in range(2):  # the lock is released
        with (
            pytest.raises(ValueError, match=r"seeds-.*policy is 'random' and 'zero': choose"),
            Folder(tmp_path, _OTHER) as folder,
        ):
            _plan(folder, range(60, 62))
    assert hashes(tmp_path).keys() == set() if parts else {"seeds-0000000060-0000000062.parquet"}


def test_a_file_in_the_place_of_the_folder_is_refused_and_stays(tmp_path: Path) -> None:
    path = tmp_path / "walk"
    path.write_text("mine")
    with pytest.raises(ValueError, match="walk is no folder: choose another name"):
        Folder(path, _RECIPE)
    assert path.read_text() == "mine"


def test_the_folder_of_an_evaluation_is_refused(tmp_path: Path) -> None:
    (tmp_path / "episodes-1-of-2.jsonl").touch()
    with pytest.raises(ValueError, match="holds an evaluation: choose another folder"):
        Folder(tmp_path, _RECIPE)
    assert [path.name for path in tmp_path.iterdir()] == ["episodes-1-of-2.jsonl"]


def test_a_second_writer_is_refused_and_shards_are_not(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    refused = pytest.raises(ValueError, match="another process writes to")
    with Folder(tmp_path, _RECIPE), refused:
        Folder(tmp_path, _RECIPE)
    with Folder(tmp_path, _RECIPE, (1, 2)), Folder(tmp_path, _RECIPE, (2, 2)), refused:
        Folder(tmp_path, _RECIPE, (2, 2))
    assert list(tmp_path.iterdir()) == []


def test_files_of_different_datasets_are_told_apart(tmp_path: Path) -> None:
    other = encode(_OTHER, made(PENDULUM, range(1), policy="zero")[1])
    paths = [
        put(tmp_path, "seeds-0000000000-0000000001.parquet", other),
        put(tmp_path, "seeds-0000000060-0000000061.parquet", _content(60, 61)),
    ]
    with pytest.raises(ValueError, match="of different datasets, whose policy is 'zero' and"):
        check_distinct([Shard(path) for path in paths])


def test_a_seed_that_two_files_have_is_refused(tmp_path: Path) -> None:
    for first, end in ((60, 63), (62, 64)):
        name = f"seeds-{first:010}-{end:010}.parquet"
        put(tmp_path, name, _content(first, end))
    with pytest.raises(ValueError, match="both have the episode of seed 62: remove one"):
        Folder(tmp_path, _RECIPE)


def test_calls_are_logged_beside_the_files(tmp_path: Path) -> None:
    for began in ("one", "two"):
        with Folder(tmp_path, _RECIPE) as folder:
            folder.log({"began": began, "ended": None})
            folder.log({"began": began, "ended": "later"})
    calls = json.loads((tmp_path / "run.json").read_text())["calls"]
    assert calls == [{"began": began, "ended": "later"} for began in ("one", "two")]
    with Folder(tmp_path, _RECIPE, (3, 8)) as folder:
        folder.log({"began": "three"})
    assert (tmp_path / "run-3-of-8.json").exists()


@pytest.mark.parametrize("text", ["", "[]", '{"calls": 3}', '{"calls": [3]}'])
def test_a_damaged_log_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(ValueError, match=r"run.json is damaged: remove it"):
        Folder(tmp_path, _RECIPE)


def test_a_part_is_written_though_another_shard_removes_their_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    removed: list[Path] = []

    @contextlib.contextmanager
    def later(path: Path, beside: Path) -> Iterator[Path]:
        if len(removed) < 9:
            beside.rmdir()  # as the process without a shard does in the end
            removed.append(beside)
        with filling(path, beside) as partial:
            yield partial

    monkeypatch.setattr("limberjack.episodes.writing.filling", later)
    with Folder(tmp_path, _RECIPE, (1, 2)) as folder:
        _plan(folder, range(60, 62))
        _add(folder, range(60, 61), range(61, 62))
    assert len(removed) == 9
    assert list(hashes(tmp_path)) == ["seeds-0000000060-0000000062.parquet"]


def test_the_first_part_may_disappear_while_a_folder_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Folder(tmp_path, _RECIPE, (1, 2)) as folder:
        _plan(folder, range(60, 63))
        _add(folder, range(60, 61), range(61, 62))

    def vanishing(path: Path) -> Shard:
        path.unlink()  # as a process does that joins it
        return Shard(path)

    monkeypatch.setattr("limberjack.episodes.folder.Shard", vanishing)
    with Folder(tmp_path, _RECIPE, (2, 2)) as folder:
        assert _plan(folder, range(60, 63)) == [60, 62]


def test_a_file_that_a_lost_worker_has_joined_is_not_joined_again(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        _plan(folder, range(60, 63))
        _add(folder, range(60, 61), range(61, 62))
        ((file, order),) = folder.add(range(62, 63), _content(62, 63))
        joined = folder.writing.join(file, [*order.named()])
        assert not any((tmp_path / "parts").iterdir())
        assert folder.writing.join(file, [*order.named()]) == joined
        folder.took(file, joined)
        folder.finish()
    assert load(tmp_path).seeds == [60, 61, 62]


def test_nothing_is_done_twice_for_a_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No part is opened but one, until a file is joined: 10,000 parts must cost no minutes."""
    opened: list[str] = []

    def opening(path: Path) -> Shard:
        opened.append(path.name)
        return Shard(path)

    monkeypatch.setattr("limberjack.episodes.folder.Shard", opening)
    monkeypatch.setattr("limberjack.episodes.writing.Shard", opening)
    for _ in range(2):
        with Folder(tmp_path, _RECIPE) as folder:
            missing = _plan(folder, range(64, 70))
            _add(folder, *(range(seed, seed + 1) for seed in missing[:2]))
    assert opened == ["seeds-0000000064-0000000065.part"]


def test_without_locks_a_second_writer_is_noticed_as_it_logs_its_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "fcntl", None)
    first, second = Folder(tmp_path, _RECIPE), Folder(tmp_path, _RECIPE)
    for number, folder in enumerate((first, second)):
        _plan(folder, range(60, 70))
        folder.log({"began": number})
    with pytest.raises(OSError, match=f"another process writes to {tmp_path}: end one of"):
        _add(first, range(60, 64))
    assert hashes(tmp_path) == {}
    _add(second, range(60, 64))
    second.log({"began": 1, "ended": "later"})
    calls = json.loads((tmp_path / "run.json").read_text())["calls"]
    assert calls == [{"began": 0}, {"began": 1, "ended": "later"}]


@pytest.mark.parametrize("text", ['{"calls": [], "notes": "mine"}', '{"calls": [{"mine": 1}]}'])
def test_a_log_of_something_else_is_refused_and_stays(text: str, tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(ValueError, match=r"run\.json is no log of a collection: choose another"):
        Folder(tmp_path, _RECIPE)
    assert (tmp_path / "run.json").read_text() == text


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_a_pipe_in_the_place_of_a_file_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "episodes").mkdir()
    episodes = "episodes/seeds-0000000000-0000000064.parquet"
    for name in ("run.json", "run-1-of-2.json", "dataset.json", episodes):
        os.mkfifo(tmp_path / name)
        with pytest.raises(ValueError, match=f"{name} is a pipe; expected a regular file"):
            Folder(tmp_path, _RECIPE)
        (tmp_path / name).unlink()


def test_hidden_files_of_others_are_not_removed(tmp_path: Path) -> None:
    names = (".seeds-mine.part", ".seeds-0000000060-0000000064.mine.part", "mine.txt")
    (tmp_path / "parts").mkdir()
    for name in names:
        (tmp_path / "parts" / name).write_text("mine")
    with Folder(tmp_path, _RECIPE) as folder:
        _plan(folder, range(60, 64))
        folder.log({"began": "now"})
        _add(folder, range(60, 64))
        folder.finish()
    assert {path.name for path in (tmp_path / "parts").iterdir()} == {*names}
