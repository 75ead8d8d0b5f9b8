"""The registry: names and modules, listeners and facts about tasks."""

from collections.abc import Iterator
from pathlib import Path

import pytest

import limberjack
from limberjack import registry
from limberjack.registry import Domain, Row
from tests.programs import run

_PACKAGE = Path(limberjack.__file__).parent
_ROWS = (Row("swing", "up", ("easy",), 500, 1), Row("swing", "down", (), None, 1))


@pytest.fixture
def swing() -> Iterator[Domain]:
    """A domain that is removed again."""
    domain = Domain("swing", "colorsys", _ROWS, source="registered")
    registry.add(domain)
    yield domain
    if "swing" in registry.domains():
        registry.remove("swing")


def test_steps_are_those_of_the_rows_and_none_where_they_are_not_known(swing: Domain) -> None:
    assert registry.steps("humanoid", "walk") == 1000
    assert registry.steps("swing", "up") == 500
    assert registry.steps("swing", "down") is None
    assert registry.steps("swing", "no such task") is None
    assert registry.steps("no such domain", "up") is None


def test_the_view_of_all_domains_cannot_be_changed(swing: Domain) -> None:
    with pytest.raises(TypeError):
        registry.domains()["other"] = swing  # pyright: ignore[reportIndexIssue]


def test_a_listener_receives_existing_domains_and_every_change(
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


def test_tasks_are_grouped_by_domain_in_their_order() -> None:
    pairs = [("swing", "up"), ("pole", "turn"), ("swing", "down")]
    assert registry.by_domain(pairs) == {"swing": ("up", "down"), "pole": ("turn",)}
    assert registry.by_domain([]) == {}


def test_the_registry_begins_with_the_suites_domains_and_their_rows() -> None:
    for name in registry.by_domain((row.domain, row.task) for row in registry.TASKS):
        domain = registry.domains()[name]
        assert domain.source == "suite"
        assert domain.module == registry.suite_module(name) == f"limberjack.suite.{name}"
        assert domain.rows == tuple(row for row in registry.TASKS if row.domain == name)


def test_removing_an_unknown_domain_is_a_key_error() -> None:
    with pytest.raises(KeyError, match="nowhere"):
        registry.remove("nowhere")


def test_importing_the_registry_imports_neither_numpy_nor_mujoco_nor_a_domain() -> None:
    program = """
    import sys, types
    package = types.ModuleType("limberjack")  # without what `import limberjack` registers
    package.__path__ = [sys.argv[1]]
    sys.modules["limberjack"] = package
    import limberjack.registry
    heavy = {"numpy", "mujoco", "gymnasium", "limberjack.suite"}
    print(sorted(heavy & set(sys.modules)))
    """
    assert run(program, str(_PACKAGE)) == "[]\n"
