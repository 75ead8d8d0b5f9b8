"""Input files: only regular ones are read."""

import os
import re
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from limberjack.utils.regular import check_regular, open_regular, read_regular

_Read = Callable[[Path], object]


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
