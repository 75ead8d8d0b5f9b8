"""The folder of a dataset: what is missing, what is written, and what is refused."""

import json
import os
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest

from limberjack.episodes.folder import Folder, blocks, shards_in
from limberjack.episodes.parquet import Shard, encode
from limberjack.utils import files

from .collected import PENDULUM, hashes, made

_RECIPE, _EPISODES = made(PENDULUM, range(60, 70))
_OTHER, _ = made(PENDULUM, range(1), policy="zero")


def _content(first: int, end: int) -> bytes:
    return encode(_RECIPE, _EPISODES[first - 60 : end - 60])


def test_blocks_are_split_at_multiples_of_64_and_at_gaps() -> None:
    assert list(blocks([])) == []
    assert list(blocks(range(60, 130))) == [range(60, 64), range(64, 128), range(128, 130)]
    assert list(blocks([1, 2, 5, 63, 64])) == [
        range(1, 3),
        range(5, 6),
        range(63, 64),
        range(64, 65),
    ]


def test_a_whole_file_is_written_at_once(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        assert folder.plan(range(60, 66)) == list(range(60, 66))
        folder.add(range(60, 64), _content(60, 64))
        assert [path.name for path in tmp_path.iterdir()] == ["seeds-0000000060-0000000064.parquet"]
    with Folder(tmp_path, _RECIPE) as folder:
        assert folder.plan(range(58, 70)) == [58, 59, *range(64, 70)]


def test_parts_are_kept_until_their_file_is_complete(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        folder.plan(range(60, 63))
        folder.add(range(61, 62), _content(61, 62))
        folder.add(range(60, 61), _content(60, 61))
    assert hashes(tmp_path) == {}
    with Folder(tmp_path, _RECIPE) as folder:
        assert folder.plan(range(60, 63)) == [62]
        folder.add(range(62, 63), _content(62, 63))
    (path,) = tmp_path.iterdir()
    assert path.read_bytes() == _content(60, 63)


def test_a_process_that_died_between_parts_and_file_is_made_up_for(tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        folder.plan(range(60, 63))
        for seed in (60, 61):
            folder.add(range(seed, seed + 1), _content(seed, seed + 1))
    with Folder(tmp_path, _RECIPE) as folder:
        assert folder.plan(range(60, 62)) == []
    (path,) = tmp_path.iterdir()
    assert path.read_bytes() == _content(60, 62)


def test_files_that_a_killed_process_left_unfinished_are_removed(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    left = [
        tmp_path / ".seeds-0000000060-0000000064.77.parquet",
        tmp_path / "parts" / ".seeds-0000000061-0000000062.77.parquet",
    ]
    other = tmp_path / ".seeds-0000000128-0000000192.78.parquet"  # of another process, maybe
    for path in (*left, other):
        path.write_bytes(b"PAR1")
    with Folder(tmp_path, _RECIPE) as folder:
        folder.plan(range(60, 64))
        folder.log({"began": "now"})
    assert set(tmp_path.iterdir()) == {other, tmp_path / "run.json"}


def test_a_dataset_that_may_not_fit_is_refused_before_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Usage(NamedTuple):
        free: int

    needed = _RECIPE.most_nbytes(episodes=3, files=1)
    with Folder(tmp_path, _RECIPE) as folder:
        monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(needed - 1))
        with pytest.raises(ValueError, match=r"3 episodes may take .* MB, and .* has .* MB left: "):
            folder.plan(range(3))
        monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(needed))
        assert folder.plan(range(3)) == [0, 1, 2]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("parts", [False, True])
def test_a_folder_with_another_dataset_is_refused_by_name(parts: bool, tmp_path: Path) -> None:
    with Folder(tmp_path, _RECIPE) as folder:
        folder.plan(range(60, 62))
        end = 61 if parts else 62
        folder.add(range(60, end), _content(60, end))
    for _ in range(2):  # the lock is released
        with pytest.raises(ValueError, match=r"seeds-.*policy is 'random' and 'zero': choose"):
            Folder(tmp_path, _OTHER)


def test_a_second_writer_is_refused_and_shards_are_not(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    refused = pytest.raises(ValueError, match="another process writes to")
    with Folder(tmp_path, _RECIPE), refused:
        Folder(tmp_path, _RECIPE)
    with Folder(tmp_path, _RECIPE, (1, 2)), Folder(tmp_path, _RECIPE, (2, 2)), refused:
        Folder(tmp_path, _RECIPE, (2, 2))
    assert list(tmp_path.iterdir()) == []


def test_files_of_different_datasets_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "seeds-0000000000-0000000001.parquet").write_bytes(
        encode(_OTHER, made(PENDULUM, range(1), policy="zero")[1])
    )
    (tmp_path / "seeds-0000000060-0000000061.parquet").write_bytes(_content(60, 61))
    with pytest.raises(ValueError, match="of different datasets, whose policy is 'zero' and"):
        shards_in(tmp_path)


def test_a_seed_that_two_files_have_is_refused(tmp_path: Path) -> None:
    for first, end in ((60, 63), (62, 64)):
        name = f"seeds-{first:010}-{end:010}.parquet"
        (tmp_path / name).write_bytes(_content(first, end))
    with pytest.raises(ValueError, match="both have the episode of seed 62: remove one"):
        shards_in(tmp_path)


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
    write, removed = Folder._write, 0

    def later(folder: Folder, path: Path, content: bytes) -> None:
        nonlocal removed
        if not removed:
            removed += 1
            path.parent.rmdir()  # as another shard does that has joined its parts
        write(folder, path, content)

    monkeypatch.setattr(Folder, "_write", later)
    with Folder(tmp_path, _RECIPE, (1, 2)) as folder:
        folder.plan(range(60, 62))
        for seed in (60, 61):
            folder.add(range(seed, seed + 1), _content(seed, seed + 1))
    assert removed == 1
    assert list(hashes(tmp_path)) == ["seeds-0000000060-0000000062.parquet"]


def test_parts_of_another_shard_may_disappear_while_a_folder_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Folder(tmp_path, _RECIPE, (1, 2)) as folder:
        folder.plan(range(60, 63))
        for seed in (60, 61):
            folder.add(range(seed, seed + 1), _content(seed, seed + 1))

    def vanishing(path: Path) -> Shard:
        if path.name.startswith("seeds-0000000060"):
            path.unlink()
        return Shard(path)

    monkeypatch.setattr("limberjack.episodes.folder.Shard", vanishing)
    with Folder(tmp_path, _RECIPE, (2, 2)) as folder:
        assert folder.plan(range(60, 63)) == [60, 62]


def test_without_locks_a_second_writer_is_noticed_as_it_logs_its_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "fcntl", None)
    first, second = Folder(tmp_path, _RECIPE), Folder(tmp_path, _RECIPE)
    for number, folder in enumerate((first, second)):
        folder.plan(range(60, 70))
        folder.log({"began": number})
    with pytest.raises(OSError, match=f"another process writes to {tmp_path}: end one of"):
        first.add(range(60, 64), _content(60, 64))
    assert hashes(tmp_path) == {}
    second.add(range(60, 64), _content(60, 64))
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
    for name in ("run.json", "run-1-of-2.json", "seeds-0000000000-0000000064.parquet"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(ValueError, match=f"{name} is a pipe; expected a regular file"):
            Folder(tmp_path, _RECIPE)
        (tmp_path / name).unlink()


def test_hidden_files_of_others_are_not_removed(tmp_path: Path) -> None:
    names = (".seeds-mine.parquet", ".seeds-0000000060-0000000064.mine.parquet")
    for name in names:
        (tmp_path / name).write_text("mine")
    with Folder(tmp_path, _RECIPE) as folder:
        folder.plan(range(60, 64))
        folder.log({"began": "now"})
    assert {path.name for path in tmp_path.iterdir()} == {*names, "run.json"}
