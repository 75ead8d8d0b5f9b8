"""Paths and URLs name places, which are read alike."""

import os
from pathlib import Path

import pytest

from limberjack.episodes.places import (
    check_file,
    exists,
    local,
    named,
    opened,
    place_of,
    size_of,
)

fsspec = pytest.importorskip("fsspec", reason="needs the extra 'data'")


@pytest.mark.parametrize("name", ["walk", "/data/walk", "C:\\walk", "a:/b", "one://"])
def test_a_name_without_a_protocol_is_a_path(name: str) -> None:
    if name == "one://":
        with pytest.raises(ValueError, match="one:// is no URL that fsspec reads"):
            place_of(name)
        return
    assert place_of(name) == Path(name)
    assert place_of(Path(name)) == Path(name)


def test_the_empty_name_is_refused() -> None:
    with pytest.raises(ValueError, match="the name of the folder is empty; expected a path or a U"):
        place_of("")  # such as a variable of the shell that is not set


def test_a_link_to_nothing_is_there(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "nothing")
    assert exists(tmp_path / "link")


def test_a_url_of_this_machine_is_a_path(tmp_path: Path) -> None:
    folder = tmp_path / "with a blank"
    assert place_of(folder.as_uri()) == folder
    assert place_of("file://localhost/data/walk") == Path("/data/walk")


def test_a_url_of_a_file_elsewhere_is_no_path_here() -> None:
    with pytest.raises(ValueError, match="file://data/walk names the machine 'data'; expected an"):
        place_of("file://data/walk")


def test_a_folder_that_must_be_here_is_no_url(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert local("walk") == local(Path("walk")) == tmp_path / "walk"
    for url in ("s3://bucket/walk", "file:///data/walk"):
        with pytest.raises(ValueError, match=f"{url} is a URL; expected the path of a folder"):
            local(url)


@pytest.mark.parametrize("is_remote", [False, True])
def test_files_are_found_and_read(is_remote: bool, tmp_path: Path) -> None:
    for name in ("b.txt", "a.txt", ".hidden", "c.bin"):
        (tmp_path / name).write_bytes(name.encode())
    folder = place_of(tmp_path)
    if is_remote:
        fsspec.filesystem("memory").put(str(tmp_path), "/places", recursive=True)
        folder = place_of("memory://places")
    assert [path.name for path in named(folder, "*.txt")] == ["a.txt", "b.txt"]
    assert [path.name for path in named(folder, "*")] == [".hidden", "a.txt", "b.txt", "c.bin"]
    assert named(folder / "none", "*") == []
    path = folder / "a.txt"
    assert (exists(path), exists(folder), exists(folder / "none")) == (True, True, False)
    assert (path.name, path.suffix, (folder / ".hidden").suffix) == ("a.txt", ".txt", "")
    assert size_of(path) == 5
    check_file(path)
    with opened(path) as file:
        assert (file.read(2), file.tell(), file.seek(1), file.read()) == (b"a.", 2, 1, b".txt")
    with pytest.raises(FileNotFoundError, match="none"):
        opened(folder / "none")
    if is_remote:
        fsspec.filesystem("memory").rm("/places", recursive=True)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for use in (check_file, opened):
        with pytest.raises(ValueError, match="is a pipe"):
            use(tmp_path / "pipe")
