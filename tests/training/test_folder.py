"""A folder belongs to one run, and what is in it is whole."""

import contextlib
import errno
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from limberjack.training.folder import Folder, opened

_IDENTITY: dict[str, Any] = {"task": "walk", "seed": 0, "settings": {"steps": 10}}


def _opened(directory: Path, **changed: object) -> contextlib.AbstractContextManager[Folder]:
    versions = {"mujoco": "4.0.0"}
    more = {"command": "limberjack train", "versions": changed.pop("versions", versions)}
    return opened(directory, {**_IDENTITY, **changed}, more)


def _open(directory: Path, **changed: object) -> None:
    with _opened(directory, **changed):
        pass


def test_a_folder_opens_again_with_the_same_identity(tmp_path: Path) -> None:
    for _ in range(2):
        with _opened(tmp_path / "run") as folder:
            assert not folder.policy.exists()
            assert folder.load() is None


def test_a_curve_has_all_digits(tmp_path: Path) -> None:
    numbers = np.array([[2.0, 1 / 3], [1e6 + 1, -1e-17]])
    with _opened(tmp_path) as folder:
        folder.write_curve(["steps", "return"], numbers)
        assert folder.curve.read_text().splitlines()[0] == "steps,return"
        read = np.loadtxt(folder.curve, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(read, numbers)


def test_one_process_at_a_time_writes(tmp_path: Path) -> None:
    with _opened(tmp_path), pytest.raises(ValueError, match="another process writes to"):
        _open(tmp_path)
    _open(tmp_path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"seed": 1}, "has a run whose seed is 0, not 1: choose another folder$"),
        (
            {"settings": {"steps": 20}},
            r"whose settings\.steps is 10, not 20: choose .*, or give the settings in its training",
        ),
    ],
)
def test_another_run_is_refused_by_name(
    changed: dict[str, object], message: str, tmp_path: Path
) -> None:
    _open(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(ValueError, match=message):
        _open(tmp_path, **changed)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    _open(tmp_path)  # the lock is free


def test_a_run_without_an_entry_for_its_world_is_one_of_the_tasks_own(tmp_path: Path) -> None:
    _open(tmp_path)
    _open(tmp_path, world=None)
    with pytest.raises(ValueError, match=r"has a run whose world is None, not {'faults': 'easy'}"):
        _open(tmp_path, world={"faults": "easy"})


def test_an_unfinished_run_of_another_series_of_versions_is_refused(tmp_path: Path) -> None:
    _open(tmp_path)
    _open(tmp_path, versions={"mujoco": "4.0.9"})
    message = r"has a run whose versions is {'mujoco': '4\.0\.0'}, not {'mujoco': '4\.1\.0'}"
    with pytest.raises(ValueError, match=message):
        _open(tmp_path, versions={"mujoco": "4.1.0"})
    with _opened(tmp_path) as folder:
        folder.policy.touch()
    _open(tmp_path, versions={"mujoco": "4.1.0"})  # a finished one is only reported


def test_a_finished_run_is_reported_where_nothing_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path, **kwargs: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    with _opened(tmp_path) as folder:
        folder.policy.touch()
    monkeypatch.setattr(Path, "unlink", refuse)  # as a disk that is read-only does
    with _opened(tmp_path) as folder:
        folder.finish()


def test_a_folder_with_other_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(ValueError, match=r"has other files, such as thesis.tex"):
        _open(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"{}", b"\xff", b"[" * 10**5])
def test_a_damaged_identity_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "training.json").write_bytes(content)
    with pytest.raises(ValueError, match=r"training\.json is damaged: choose another folder"):
        _open(tmp_path)


def test_a_run_of_a_function_is_none_of_a_named_task(tmp_path: Path) -> None:
    _open(tmp_path)
    with (
        pytest.raises(ValueError, match=r"a run whose environment is None, not 'mine:make'"),
        opened(tmp_path, {"environment": "mine:make", "seed": 0}, {}),
    ):
        pass


def test_files_that_a_killed_process_left_unfinished_are_removed(tmp_path: Path) -> None:
    _open(tmp_path)
    left = tmp_path / ".policy.0123456789abcdef.safetensors"
    left.write_bytes(b"half")
    mine = tmp_path / ".gitignore"
    mine.write_text("*")
    _open(tmp_path)
    assert not left.exists()
    assert mine.exists()


def test_a_checkpoint_is_replaced_whole_and_removed_at_the_end(tmp_path: Path) -> None:
    with _opened(tmp_path) as folder:
        folder.save({"steps": 1})
        folder.save({"steps": 2})
        with pytest.raises(TypeError, match="pickle"):
            folder.save({"steps": 3, "not to be pickled": (i for i in range(3))})
        assert folder.load() == {"steps": 2}
        folder.finish()
        assert folder.load() is None


def test_a_damaged_checkpoint_is_named(tmp_path: Path) -> None:
    with _opened(tmp_path) as folder:
        (tmp_path / "checkpoint.pickle").write_bytes(b"half")
        with pytest.raises(ValueError, match=r"checkpoint.pickle is damaged .*: remove it"):
            folder.load()


def test_a_checkpoint_that_cannot_be_read_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_large(file: object) -> None:
        raise MemoryError

    with _opened(tmp_path) as folder:
        folder.save({"steps": 1})
        with monkeypatch.context() as patched:
            patched.setattr("pickle.load", too_large)
            with pytest.raises(ValueError, match=r"does not fit into .*: free memory and continue"):
                folder.load()
        folder.finish()
        (tmp_path / "checkpoint.pickle").mkdir()
        with pytest.raises(IsADirectoryError):
            folder.load()
