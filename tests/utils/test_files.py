"""Atomic file replacement, and locks on folders and files."""

import contextlib
import errno
import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from limberjack.utils.files import Hold, replacing
from tests.programs import run


def test_a_file_that_is_replaced_appears_whole(tmp_path: Path) -> None:
    path = tmp_path / "name.txt"
    with replacing(path) as partial:
        partial.write_text("new")
        assert not path.exists()
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_stays_as_it_was_if_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "name.txt"
    path.write_text("old")

    def write_in_part() -> None:
        with replacing(path) as partial:
            partial.write_text("ne")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_in_part()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_of_writing_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "name.txt"

    def write() -> None:
        with replacing(path):  # as write() does on a full disk, which knows no name
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(OSError, match=r"No space left on device: '.*name\.txt'$"):
        write()
    assert not list(tmp_path.iterdir())


def test_the_content_reaches_the_disk_before_the_name_and_the_name_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, done = tmp_path / "name.txt", []
    fsync, replace = os.fsync, os.replace

    def flush(number: int) -> None:
        done.append("folder" if stat.S_ISDIR(os.fstat(number).st_mode) else "content")
        fsync(number)

    monkeypatch.setattr(os, "fsync", flush)
    monkeypatch.setattr(os, "replace", lambda *paths: (done.append("name"), replace(*paths)))
    with replacing(path) as partial:
        partial.write_text("new")
    assert done == ["content", "name", "folder"]


needs_locks = pytest.mark.skipif(os.name == "nt", reason="Windows has no fcntl")


@needs_locks
def test_a_folder_or_file_that_is_held_is_refused_until_it_is_released(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "film.mp4"):
        with Hold(path), pytest.raises(ValueError, match=f"another process writes to {path}: wait"):
            Hold(path)
        first = Hold(path)
        first.release()
        first.release()
        Hold(path).release()
    assert not list(tmp_path.iterdir())


@needs_locks
def test_the_hold_of_a_process_that_was_killed_is_gone(tmp_path: Path) -> None:
    path = tmp_path / "film.mp4"
    program = f"""
        import os, pathlib, signal
        from limberjack.utils.files import Hold
        hold = Hold(pathlib.Path({str(path)!r}))
        os.kill(os.getpid(), signal.SIGKILL)
    """
    with pytest.raises(AssertionError):  # `run` fails, as the program does not end well
        run(program)
    assert [left.name for left in tmp_path.iterdir()] == [".film.mp4.lock"]
    with Hold(path):
        pass
    assert not list(tmp_path.iterdir())


@needs_locks
def test_two_that_take_turns_never_hold_a_file_at_once(tmp_path: Path) -> None:
    path, holders, most = tmp_path / "film.mp4", [], []

    def take_turns() -> None:
        for _ in range(200):
            with contextlib.suppress(ValueError), Hold(path):
                holders.append(None)
                most.append(len(holders))
                holders.pop()

    with ThreadPoolExecutor(4) as pool:
        for done in [pool.submit(take_turns) for _ in range(4)]:
            done.result()
    assert set(most) == {1}
