"""The registry: names and modules, listeners, the table's facts."""

import sys
from collections.abc import Iterator
from types import ModuleType

import pytest

from limberjack import registry
from limberjack.registry import Domain, Row

_ROWS = (Row("swing", "up", ("easy",), 500, 1), Row("swing", "down", (), None, 1))


@pytest.fixture
def swing() -> Iterator[Domain]:
    """A domain that is removed again."""
    domain = Domain("swing", "colorsys", _ROWS, source="registered")
    registry.add(domain)
    yield domain
    if "swing" in registry.domains():
        registry.remove("swing")


def test_a_domain_is_imported_when_it_is_loaded(swing: Domain) -> None:
    sys.modules.pop("colorsys", None)
    assert registry.domains()["swing"] is swing
    assert "colorsys" not in sys.modules
    assert swing.load() is sys.modules["colorsys"]
    assert swing.import_name == "colorsys"


def test_steps_are_those_of_the_rows_and_none_where_they_are_not_known(swing: Domain) -> None:
    assert registry.steps("humanoid", "walk") == 1000
    assert registry.steps("swing", "up") == 500
    assert registry.steps("swing", "down") is None
    assert registry.steps("swing", "no such task") is None
    assert registry.steps("no such domain", "up") is None


def test_the_view_of_all_domains_cannot_be_changed(swing: Domain) -> None:
    with pytest.raises(TypeError):
        registry.domains()["other"] = swing  # pyright: ignore[reportIndexIssue]


def test_a_listener_hears_of_what_is_there_and_of_every_change(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(registry, "_listeners", [])
    heard: list[tuple[str, bool]] = []
    registry.listen(lambda domain, is_added: heard.append((domain.name, is_added)))
    assert heard == [(name, True) for name in registry.domains()]
    del heard[:]
    registry.add(Domain("swing", "colorsys", _ROWS, source="registered"))
    registry.add(Domain("swing", "copy", _ROWS, source="registered"))
    registry.remove("swing")
    assert heard == [("swing", is_added) for is_added in (True, False, True, False)]


def test_the_largest_task_has_the_most_degrees_of_freedom() -> None:
    largest = registry.largest_task()
    (dof,) = [row.dof for row in registry.TASKS if (row.domain, row.task) == largest]
    assert dof == max(row.dof for row in registry.TASKS)


def test_a_module_that_another_process_cannot_import_has_no_import_name() -> None:
    assert registry.import_name_of(sys.modules["sys"]) == "sys"
    assert registry.import_name_of(ModuleType("sys")) is None
    assert registry.import_name_of(ModuleType("nowhere")) is None
    assert registry.import_name_of(ModuleType("__main__")) is None
