"""Folders in other formats are there completely or not at all."""

from pathlib import Path

import pytest

from limberjack.episodes.converting import converted
from limberjack.utils.files import Hold


def _write(folder: Path, text: str) -> None:
    with converted(folder, lambda path: (path / "ours").exists()) as partial:
        assert folder.parent == partial.parent
        (partial / "ours").write_text(text)
        if text == "interrupted":
            raise KeyboardInterrupt


def test_a_folder_appears_when_it_is_complete_and_replaces_an_earlier_one(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "out"
    for text in ("one", "two"):
        _write(folder, text)
        assert (folder / "ours").read_text() == text
    assert [path.name for path in folder.parent.iterdir()] == ["out"]


def test_after_an_error_the_earlier_folder_is_there_and_nothing_else(tmp_path: Path) -> None:
    _write(tmp_path / "out", "one")
    with pytest.raises(KeyboardInterrupt):
        _write(tmp_path / "out", "interrupted")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out" / "ours").read_text() == "one"


def test_what_a_killed_process_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / ".out.0123456789abcdef" / "data").mkdir(parents=True)
    (tmp_path / ".out.mine").mkdir()
    _write(tmp_path / "out", "one")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".out.mine", "out"]


def test_what_is_no_conversion_is_refused(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("out", "link"):
        with pytest.raises(ValueError, match=f"{name} exists: remove it, or choose another folder"):
            _write(tmp_path / name, "one")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "out"]


def test_two_conversions_into_one_folder_at_once_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on this system")
    _write(tmp_path / "out", "one")
    with Hold(tmp_path / "out"), pytest.raises(ValueError, match="another process writes to"):
        _write(tmp_path / "out", "two")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out" / "ours").read_text() == "one"
