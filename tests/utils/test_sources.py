"""Hashes of sources."""

import functools
import importlib
import sys
from pathlib import Path

import pytest

from limberjack.utils.sources import (
    defined_in,
    hash_of_files,
    hash_of_module,
    hash_of_source,
    imported,
)


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An importable package `hashed` with a module in a package within."""
    folder = tmp_path / "hashed"
    (folder / "inner").mkdir(parents=True)
    for name in ("__init__.py", "inner/__init__.py", "network.py"):
        (folder / name).write_text("")
    (folder / "inner" / "policy.py").write_text("def act(observation): ...\nclass Policy: ...\n")
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("hashed", "hashed.inner", "hashed.inner.policy"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return folder


def test_any_python_file_of_the_package_changes_the_hash(package: Path) -> None:
    module = importlib.import_module("hashed.inner.policy")
    before = hash_of_module(module.__name__)
    assert before == hash_of_source(module.act) == hash_of_source(module.Policy())
    (package / "weights.bin").write_text("not a source")
    assert hash_of_module(module.__name__) == before
    (package / "network.py").write_text("# imported in whatever manner\n")
    assert hash_of_module(module.__name__) != before


def test_what_editors_leave_in_a_package_is_no_source(package: Path) -> None:
    module = importlib.import_module("hashed.inner.policy")
    before = hash_of_module(module.__name__)
    (package / ".#network.py").symlink_to("user@host.123:456")  # Emacs's lock of an open file
    (package / "folder.py").mkdir()
    assert hash_of_module(module.__name__) == before


def test_a_module_in_no_package_stands_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "alone.py").write_text("a = 1\n")
    importlib.import_module("alone")
    before = hash_of_module("alone")
    (tmp_path / "neighbour.py").write_text("b = 2\n")
    assert hash_of_module("alone") == before
    (tmp_path / "alone.py").write_text("a = 2\n")
    assert hash_of_module("alone") != before


def test_a_folder_without_an_init_counts_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "policy.py").write_text("")
    importlib.import_module("folder.policy")
    before = hash_of_module("folder.policy")
    (tmp_path / "folder" / "network.py").write_text("")
    assert hash_of_module("folder.policy") != before


def test_names_count_and_where_they_lie_does_not(tmp_path: Path) -> None:
    hashes = []
    for folder, names in (("a", ("x", "y")), ("b", ("x", "y")), ("c", ("x", "z"))):
        (tmp_path / folder).mkdir()
        files = [tmp_path / folder / name for name in names]
        for file in files:
            file.write_text("same")
        hashes.append(hash_of_files(files))
        assert hash_of_files(reversed(files)) == hashes[-1]
    assert hashes[0] == hashes[1] != hashes[2]


def test_a_module_without_a_file_has_no_hash() -> None:
    assert hash_of_module("sys") is None
    assert hash_of_module("not_imported") is None


def test_a_partial_is_defined_where_its_function_is() -> None:
    assert defined_in(functools.partial(functools.partial(hash_of_files), [])) is hash_of_files
    assert defined_in(Path()) is type(Path())


def test_an_imported_object_is_found_by_its_name() -> None:
    assert imported(f"{__name__}:test_an_imported_object_is_found_by_its_name") is (
        test_an_imported_object_is_found_by_its_name
    )
    assert imported(f"{__name__}:nothing.there") is None
    assert imported("not_imported:nothing") is None
