"""Files that appear whole or not at all."""

import errno
import os
from pathlib import Path

import pytest

from limberjack.utils.files import replacing


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
