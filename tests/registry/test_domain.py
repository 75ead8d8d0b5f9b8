"""Domains of the registry and their modules, imported or not."""

import copy
import dataclasses
import importlib
import importlib.util
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from limberjack import registry
from limberjack.registry import Domain, NotImportable, Row, import_name_of

_ROWS = (Row("swing", "up", (), 500, 1),)
_NAME = "a_domain_of_these_tests"

_ROW = Row("swing", "up", ("easy",), None, 1)


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


def test_a_row_has_its_facts_in_order_and_by_name() -> None:
    assert tuple(_ROW) == ("swing", "up", ("easy",), None, 1, None, None)
    assert (_ROW.domain, _ROW.task, _ROW.tags, _ROW.steps, _ROW.dof) == _ROW[:5]
    assert (_ROW.actions, _ROW.observations) == _ROW[5:]


def test_rows_are_values_that_cannot_be_changed() -> None:
    assert len({_ROW, Row("swing", "up", ("easy",), None, 1), _ROW._replace(dof=2)}) == 2
    with pytest.raises(AttributeError):
        _ROW.steps = 5  # pyright: ignore[reportAttributeAccessIssue]


def test_a_row_is_pickled_as_itself() -> None:
    copy = pickle.loads(pickle.dumps(_ROW))
    assert type(copy) is Row
    assert copy == _ROW


def test_the_suites_rows_have_facts_of_the_right_kinds() -> None:
    for row in registry.TASKS:
        assert row.domain.isidentifier()
        assert row.task.isidentifier()
        assert type(row.tags) is tuple
        assert row.steps is None or row.steps > 0
        assert row.dof > 0


def test_it_is_copied_and_refuses_to_be_pickled_with_advice() -> None:
    nowhere = NotImportable("swing")
    assert copy.deepcopy(nowhere) is nowhere
    with pytest.raises(pickle.PicklingError, match=r"'swing' .* such as my_package/swing\.py"):
        pickle.dumps(nowhere)
