"""Repairs: damaged files are moved aside and made again; nothing else is touched."""

import json
import logging
import shutil
from pathlib import Path

import pytest

from limberjack.data import Dataset, Kept, collect, load
from limberjack.episodes.parquet import encode
from limberjack.episodes.repairing import set_aside
from limberjack.utils.files import Hold

from .collected import PENDULUM, copy, folder_of, of_64, whole_hashes
from .collected import damaged as damaged_content

_FIRST, _SECOND = "seeds-0000000000-0000000064.parquet", "seeds-0000000064-0000000070.parquet"


@pytest.fixture
def folder(pendulums: Dataset, tmp_path: Path) -> Path:
    """A copy of a dataset of two files."""
    return copy(folder_of(pendulums), tmp_path / "data")


def _repair(folder: "Path | str", seeds: range = range(70), kept: Kept | None = None) -> None:
    domain, task, seconds = PENDULUM
    how = {"time_limit": seconds, "num_threads": 1, "file_mb": of_64(PENDULUM)}
    collect(domain, task, "random", seeds, out=folder, kept=kept, repair=True, **how)


def _times(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


def _moved(folder: Path) -> list[str]:
    """The names of files that were moved; then the folder is as others are."""
    names = sorted(path.name for path in (folder / "damaged").iterdir())
    shutil.rmtree(folder / "damaged")
    return names


@pytest.mark.parametrize(
    ("damage", "is_listed"),
    [("a page", False), ("a footer", True), ("empty", True), ("bytes", True), ("a name", False)],
)
def test_a_damaged_file_is_moved_aside_and_made_again(
    damage: str,
    is_listed: bool,  # otherwise there is no manifest, with whose SHA-256 it could be compared
    folder: Path,
    pendulums: Dataset,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = folder / "episodes" / _FIRST
    content = path.read_bytes()
    changed = {
        "a page": damaged_content(content),
        "a footer": content[:-1],
        "empty": b"",
        "bytes": _otherwise(pendulums, monkeypatch),
        "a name": (folder / "episodes" / _SECOND).read_bytes(),
    }[damage]
    path.write_bytes(changed)
    if not is_listed:
        (folder / "dataset.json").unlink()
    with caplog.at_level(logging.WARNING, "limberjack"):
        _repair(folder)
    there = folder / "damaged" / _FIRST
    assert f"{path} is damaged: it was moved to {there}, and is made again" in caplog.messages
    assert there.read_bytes() == changed
    assert _moved(folder) == [_FIRST]
    assert whole_hashes(folder) == whole_hashes(folder_of(pendulums))
    load(folder).verify()


def _otherwise(pendulums: Dataset, monkeypatch: pytest.MonkeyPatch) -> bytes:
    """A whole file with the episodes of the first one, which is written in another way."""
    with monkeypatch.context() as patch:
        patch.setattr("limberjack.episodes.parquet.GROUP_NBYTES", 1)
        return encode(pendulums.recipe, [*pendulums.episodes_of(0)])


def test_without_damage_a_repair_changes_nothing(folder: Path) -> None:
    before = _times(folder)
    _repair(folder)
    assert _times(folder) == before
    assert set_aside(folder / "missing", load(folder).recipe) == []


def test_all_episodes_of_damaged_files_are_made_again_with_the_seeds_that_are_given(
    folder: Path, pendulums: Dataset
) -> None:
    for _ in range(2):
        for name in (_FIRST, _SECOND):
            (folder / "episodes" / name).write_bytes(b"PAR1")
        _repair(folder, range(3))
    assert load(folder).seeds == list(range(70))
    assert _moved(folder) == [_FIRST, f"{_FIRST}.2", _SECOND, f"{_SECOND}.2"]
    assert whole_hashes(folder) == whole_hashes(folder_of(pendulums))


def test_damaged_lists_and_parts_are_moved_aside(folder: Path, pendulums: Dataset) -> None:
    (folder / "dataset.json").write_text("{")
    (folder / "parts").mkdir()
    (folder / "parts" / "dataset-1-of-2.json").write_text("")
    (folder / "episodes" / _SECOND).unlink()
    (folder / "parts" / "seeds-0000000064-0000000070.part").write_bytes(b"PAR1")
    _repair(folder)
    assert _moved(folder) == [
        "dataset-1-of-2.json",
        "dataset.json",
        "seeds-0000000064-0000000070.part",
    ]
    assert whole_hashes(folder) == whole_hashes(folder_of(pendulums))


@pytest.mark.parametrize("part", ["files", "steps", "statistics"])
def test_a_manifest_with_other_figures_than_the_episodes_is_found_and_made_again(
    part: str, folder: Path, pendulums: Dataset
) -> None:
    path = folder / "dataset.json"
    content = json.loads(path.read_text())
    changed = {"steps": 9, "statistics": {}, "files": content["files"]}
    content["files"][0]["returns"][1] = 777.0
    path.write_text(json.dumps({**content, part: changed[part]}))
    with pytest.raises(
        ValueError, match=rf"the {part} in .* are not those of the episodes.*--repair"
    ):
        load(folder).verify()
    _repair(folder)
    assert _moved(folder) == ["dataset.json"]
    assert whole_hashes(folder) == whole_hashes(folder_of(pendulums))
    load(folder).verify()


def test_a_manifest_with_another_number_of_rows_than_a_file_is_made_again(
    folder: Path, pendulums: Dataset
) -> None:
    content = json.loads((folder / "dataset.json").read_text())
    content["files"][0]["rows"] += 1
    content["steps"] += 1
    (folder / "dataset.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=r"is not the file that dataset\.json lists, whose seeds"):
        load(folder)
    _repair(folder)
    assert _moved(folder) == ["dataset.json"]
    assert whole_hashes(folder) == whole_hashes(folder_of(pendulums))


def test_a_dataset_at_a_url_is_repaired(folder: Path, pendulums: Dataset) -> None:
    fsspec = pytest.importorskip("fsspec", reason="needs the extra 'data'")
    files = fsspec.filesystem("memory")
    files.put(str(folder), "/repaired", recursive=True)
    try:
        files.pipe_file(f"/repaired/episodes/{_SECOND}", b"PAR1")
        _repair("memory://repaired")
        assert files.cat_file(f"/repaired/damaged/{_SECOND}") == b"PAR1"
        load("memory://repaired").verify()
    finally:
        files.rm("/repaired", recursive=True)


def test_another_dataset_is_refused_and_nothing_is_moved(folder: Path) -> None:
    whole = (folder / "episodes" / _SECOND).read_bytes()
    for name in (_FIRST, _SECOND):
        (folder / "episodes" / name).write_bytes(b"PAR1")
    for is_listed in (True, False):  # as the manifest alone says, and as a file alone does
        if not is_listed:
            (folder / "dataset.json").unlink()
            (folder / "episodes" / _SECOND).write_bytes(whole)
        before = _times(folder)
        with pytest.raises(ValueError, match=r"another dataset .*, whose flat is False and True: "):
            _repair(folder, kept=Kept(flat=True))
        assert _times(folder) == before


def test_nothing_is_moved_while_another_process_writes_or_with_a_shard(folder: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    (folder / "episodes" / _FIRST).write_bytes(b"PAR1")
    before = _times(folder)
    with Hold(folder), pytest.raises(ValueError, match="another process writes to"):
        _repair(folder)
    with pytest.raises(ValueError, match="repair and shard are both given: repair the dataset"):
        collect(*PENDULUM[:2], seeds=range(2), out=folder, repair=True, shard=(1, 2))
    assert _times(folder) == before
