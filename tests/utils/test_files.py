"""Atomic file replacement, and locks on folders and files."""

import contextlib
import errno
import os
import re
import socket
import stat
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from limberjack.utils.files import (
    Hold,
    Partial,
    appending,
    check_regular,
    open_regular,
    read_regular,
    replacing,
)
from tests.programs import run

_Read = Callable[[Path], object]


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


needs_links = pytest.mark.skipif(os.name == "nt", reason="Windows links need a privilege")


def test_unfinished_files_have_names_that_nobody_can_foresee(tmp_path: Path) -> None:
    path = tmp_path / ("a" * 200 + ".json")  # a long name leaves room for the letters
    first, second = Partial(path), Partial(path)
    assert first.path != second.path
    for partial in (first, second):
        assert partial.path.suffix == ".json"
        assert partial.path.name.startswith(".a")
        assert len(partial.path.stem.rpartition(".")[2]) == 16
        partial.discard()
        partial.discard()
    assert not list(tmp_path.iterdir())


@needs_links
def test_a_link_under_the_name_of_an_unfinished_file_is_never_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    victim, path = tmp_path / "victim", tmp_path / "name.txt"
    victim.write_text("precious")
    monkeypatch.setattr("limberjack.utils.files.random_letters", lambda: "guessed")
    (tmp_path / ".name.guessed.txt").symlink_to(victim)
    with pytest.raises(FileExistsError, match=r"name\.txt"), replacing(path) as partial:
        partial.write_text("new")
    (tmp_path / ".name.guessed.txt").unlink()
    (tmp_path / ".name.guessed.txt").symlink_to(tmp_path / "nothing")
    with pytest.raises(FileExistsError), replacing(path) as partial:
        partial.write_text("new")
    assert victim.read_text() == "precious"
    assert not path.exists()
    assert not (tmp_path / "nothing").exists()


@needs_links
def test_a_file_that_takes_the_unfinished_ones_place_is_refused_and_left_alone(
    tmp_path: Path,
) -> None:
    victim, path = tmp_path / "victim", tmp_path / "name.txt"
    victim.write_text("precious")
    for is_link in (True, False):
        partial = Partial(path)
        partial.path.unlink()
        if is_link:
            partial.path.symlink_to(victim)
        else:
            partial.path.write_text("planted")
        with pytest.raises(OSError, match=r"\.name\.[0-9a-f]{16}\.txt"):
            partial.finish()
        partial.discard()
        assert partial.path.is_symlink() == is_link
        assert os.path.lexists(partial.path)
    assert not path.exists()
    assert victim.read_text() == "precious"


def test_two_threads_that_save_to_one_path_never_fail(tmp_path: Path) -> None:
    path = tmp_path / "name.json"

    def save(text: str) -> None:
        for _ in range(100):
            with replacing(path) as partial:
                partial.write_text(text)

    with ThreadPoolExecutor(3) as pool:
        for done in [pool.submit(save, letter * 1000) for letter in "abc"]:
            done.result()
    assert path.read_text() in {letter * 1000 for letter in "abc"}
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="Windows has other permissions")
@pytest.mark.parametrize("umask", [0o000, 0o022, 0o027, 0o077])
def test_permissions_are_those_that_a_plain_open_gives(umask: int, tmp_path: Path) -> None:
    plain, path = tmp_path / "plain", tmp_path / "name.txt"
    before = os.umask(umask)
    try:
        plain.write_text("")
        with replacing(path) as partial:
            partial.write_text("")
        appending(tmp_path / "grows").close()
    finally:
        os.umask(before)
    for written in (path, tmp_path / "grows"):
        assert written.stat().st_mode == plain.stat().st_mode
    path.chmod(0o640)  # which opening the file again would not change
    with replacing(path) as partial:
        partial.write_text("new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


def test_a_file_that_cannot_be_moved_into_place_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*paths: Path) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(PermissionError), replacing(tmp_path / "name.txt") as partial:
        partial.write_text("new")
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_is_named_with_the_file_that_was_asked_for(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"missing/name\.txt'$"):
        Partial(tmp_path / "missing" / "name.txt")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_a_pipe_or_a_folder_is_not_replaced(tmp_path: Path) -> None:
    pipe, folder = tmp_path / "pipe", tmp_path / "folder"
    os.mkfifo(pipe)
    folder.mkdir()
    for path, message in ((pipe, "expected a file's name"), (folder, "Is a directory")):
        with pytest.raises(OSError, match=message), replacing(path) as partial:
            partial.write_text("new")
    assert pipe.is_fifo()
    assert set(tmp_path.iterdir()) == {pipe, folder}


@needs_links
def test_a_link_that_is_replaced_leaves_the_file_that_it_names(tmp_path: Path) -> None:
    victim, path = tmp_path / "victim", tmp_path / "name.txt"
    victim.write_text("precious")
    path.symlink_to(victim)
    with replacing(path) as partial:
        partial.write_text("new")
    assert victim.read_text() == "precious"
    assert not path.is_symlink()


@needs_links
def test_a_file_that_grows_is_neither_a_link_nor_a_pipe(tmp_path: Path) -> None:
    path, link, pipe = tmp_path / "file", tmp_path / "link", tmp_path / "pipe"
    with appending(path) as file:
        file.write(b"one\n")
    with appending(path) as file:
        file.write(b"two\n")
    assert path.read_text() == "one\ntwo\n"
    link.symlink_to(path)
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    os.mkfifo(pipe)
    for refused in (link, tmp_path / "dangling", pipe):
        with pytest.raises(OSError, match=refused.name):
            appending(refused)
    assert path.read_text() == "one\ntwo\n"
    assert not (tmp_path / "nothing").exists()


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


@needs_locks
def test_what_is_no_lock_file_is_refused_and_stays(tmp_path: Path) -> None:
    path, lock = tmp_path / "film.mp4", tmp_path / ".film.mp4.lock"
    victim = tmp_path / "victim"

    def refused() -> None:
        with pytest.raises(ValueError, match=r"\.film\.mp4\.lock is no lock file"):
            Hold(path)

    lock.write_text("mine")
    refused()
    assert lock.read_text() == "mine"
    lock.unlink()
    lock.symlink_to(victim)  # which opening would create
    refused()
    assert lock.is_symlink()
    assert not victim.exists()
    lock.unlink()
    os.mkfifo(lock)
    refused()
    assert lock.is_fifo()


@needs_locks
def test_a_lock_file_that_another_one_has_replaced_is_left_to_it(tmp_path: Path) -> None:
    path, lock = tmp_path / "film.mp4", tmp_path / ".film.mp4.lock"
    hold = Hold(path)
    lock.unlink()
    lock.write_text("mine")
    hold.release()
    assert lock.read_text() == "mine"


def _opened(path: Path) -> None:
    open_regular(path).close()


_ALL: list[_Read] = [check_regular, read_regular, _opened]


def test_a_regular_file_is_read_also_through_a_link(tmp_path: Path) -> None:
    path, link = tmp_path / "file", tmp_path / "link"
    path.write_bytes(b"content")
    link.symlink_to(path)
    for name in (path, link):
        check_regular(name)
        assert read_regular(name) == b"content"
        with open_regular(name) as file:
            assert file.read(3) == b"con"


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
@pytest.mark.parametrize("read", _ALL)
def test_what_may_never_end_is_refused_at_once(read: _Read, tmp_path: Path) -> None:
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    device = Path("/dev/zero")
    for path, kind in ((pipe, "a pipe"), (link, "a pipe"), (device, "a device")):
        with pytest.raises(ValueError, match=f"{path} is {kind}; expected a regular file"):
            read(path)


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="needs sockets with paths")
def test_a_socket_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # because the paths of sockets are short
    with socket.socket(socket.AF_UNIX) as opened:
        opened.bind("socket")
        with pytest.raises(ValueError, match="socket is a socket; expected a regular file"):
            read_regular(Path("socket"))


@pytest.mark.parametrize("read", _ALL)
def test_a_folder_and_a_missing_file_are_errors_of_the_system(read: _Read, tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError, match=re.escape(str(tmp_path))):
        read(tmp_path)
    with pytest.raises(FileNotFoundError):
        read(tmp_path / "missing")


@pytest.mark.skipif(os.name == "nt", reason="Windows has no special files")
def test_a_pipe_that_takes_the_files_place_meanwhile_is_refused_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, pipe = tmp_path / "file", tmp_path / "pipe"
    path.write_text("")
    os.mkfifo(pipe)
    system_open = os.open
    monkeypatch.setattr(os, "open", lambda _, *rest: system_open(pipe, *rest))
    with pytest.raises(ValueError, match="is a pipe; expected a regular file"):
        read_regular(path)
