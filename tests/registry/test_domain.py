"""Domains of the registry and their modules, imported or not."""

import dataclasses
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from limberjack.registry import Domain, Row, import_name_of

_ROWS = (Row("swing", "up", (), 500, 1),)
_NAME = "a_domain_of_these_tests"


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """The name of an importable module that is not imported yet."""
    (tmp_path / f"{_NAME}.py").write_text('"""A module."""\n', encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield _NAME
    sys.modules.pop(_NAME, None)


def test_a_module_is_imported_when_it_is_loaded(module: str) -> None:
    domain = Domain("swing", module, _ROWS, source="installed")
    assert domain.import_name == module
    assert module not in sys.modules
    assert domain.load() is sys.modules[module]
    assert domain.load() is domain.load()


def test_loading_a_domain_given_as_a_module_returns_the_module(module: str) -> None:
    given = importlib.import_module(module)
    domain = Domain("swing", given, _ROWS, source="registered")
    assert domain.load() is given
    assert domain.import_name == module


def test_a_module_that_is_gone_is_an_import_error_when_it_is_loaded() -> None:
    domain = Domain("swing", "no_such_module", _ROWS, source="installed")
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        domain.load()


def test_a_domain_cannot_be_changed() -> None:
    domain = Domain("swing", "no_such_module", _ROWS, source="installed")
    with pytest.raises(dataclasses.FrozenInstanceError):
        domain.name = "other"  # pyright: ignore[reportAttributeAccessIssue]


def test_a_module_that_another_process_cannot_import_has_no_import_name(module: str) -> None:
    assert import_name_of(sys) == "sys"
    assert import_name_of(importlib.import_module(module)) == module
    spec = importlib.util.find_spec(module)
    assert spec is not None
    again = importlib.util.module_from_spec(spec)
    assert import_name_of(again) is None  # another one of that name is imported
    assert import_name_of(ModuleType("nowhere")) is None
    assert import_name_of(ModuleType("__main__")) is None
    assert Domain("swing", ModuleType("nowhere"), _ROWS, source="assigned").import_name is None


def test_a_module_that_was_only_put_in_sys_modules_has_no_import_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = ModuleType("only_in_memory")
    monkeypatch.setitem(sys.modules, "only_in_memory", made)
    assert import_name_of(made) is None
