"""A domain is defined in one place: no other code lists domains or tasks, or uses their classes."""

import ast
import functools
import importlib
import inspect
from collections.abc import Iterator
from xml.etree import ElementTree

from limberjack.registry import TASKS, by_domain, suite_module

from .source import PACKAGE, SOURCE, modules, tree

_DOMAINS = by_domain((row.domain, row.task) for row in TASKS)
_NAMES = {*_DOMAINS, *(row.task for row in TASKS)}
_GENERATED = "limberjack.registry.table"
# The domains themselves, and the planner's costs, which are reached only through a domain.
_OWN = {suite_module(domain) for domain in _DOMAINS}
# The list of tasks that a GPU cannot step, which a test compares with what a GPU can step; the
# arm's figures, which are those of a model of the suite; papers' sets of tasks; the settings of
# training; the grades easy, medium and hard of other worlds, which are names of tasks too.
_WITH_A_REASON = {
    "limberjack.gpu",
    "limberjack.planner.arm.geometry",
    "limberjack.registry.sets",
    "limberjack.training.settings",
    "limberjack.worlds.appearance.options",
    "limberjack.worlds.faults.settings",
}
_EVERYWHERE_ELSE = [
    module for module in sorted(modules()) if module not in {*_OWN, _GENERATED, *_WITH_A_REASON}
]


def _classes() -> set[str]:
    """Names of the classes that the domains define, except for `Physics`."""
    found = {"Physics"}
    for module in map(importlib.import_module, sorted(_OWN)):
        classes = [kind for _, kind in inspect.getmembers(module, inspect.isclass)]
        found |= {kind.__name__ for kind in classes if kind.__module__ == module.__name__}
    return found - {"Physics"}


@functools.cache
def _parts_of_models() -> set[str | None]:
    """Names of bodies, joints and so on, some of which are those of domains: an arm's finger."""
    files = (SOURCE / PACKAGE / "suite").glob("*.xml")
    return {element.get("name") for file in files for element in ElementTree.parse(file).iter()}


def _nodes() -> Iterator[tuple[str, ast.AST]]:
    """Every syntax node of these modules, with the name of its module."""
    for module in _EVERYWHERE_ELSE:
        yield from ((module, node) for node in ast.walk(tree(module)))


def _strings(node: ast.AST) -> set[str]:
    """The strings that are direct elements of a list, tuple, set or dictionary."""
    if isinstance(node, ast.Dict):
        elements = [*node.keys, *node.values]
    elif isinstance(node, ast.List | ast.Tuple | ast.Set):
        elements = node.elts
    else:
        return set()
    return {e.value for e in elements if isinstance(e, ast.Constant) and isinstance(e.value, str)}


def _imported_domains(module: str) -> Iterator[str]:
    """Domains that a module imports, or reads as attributes of the suite."""
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.ImportFrom) and node.module == "limberjack.suite":
            yield from (alias.name for alias in node.names if alias.name in _DOMAINS)
        elif isinstance(node, ast.ImportFrom | ast.Import):
            names = [getattr(node, "module", None), *(alias.name for alias in node.names)]
            yield from (name for name in names if name in _OWN)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value).endswith("suite"):
            yield from {node.attr} & set(_DOMAINS)


def test_no_module_lists_domains_or_tasks_by_hand() -> None:
    for module, node in _nodes():
        listed = _strings(node) & _NAMES
        assert len(listed) < 2, f"{module}, line {getattr(node, 'lineno', 0)}, lists {listed}"
        if isinstance(node, ast.Constant) and node.value not in _parts_of_models():
            assert node.value not in _DOMAINS, f"{module}, line {node.lineno}, names {node.value}"


def test_no_module_imports_a_domain() -> None:
    found = {module: list(_imported_domains(module)) for module in _EVERYWHERE_ELSE}
    assert not {module: domains for module, domains in found.items() if domains}


def test_no_module_asks_for_the_class_of_a_domain() -> None:
    classes = _classes()
    for module, node in _nodes():
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass"):
            asked = set(ast.unparse(node.args[1]).replace("|", " ").split())
            named = {part.strip("(),").rpartition(".")[2] for part in asked}
            assert not named & classes, f"{module}, line {node.lineno}: {ast.unparse(node)}"


def test_the_search_finds_what_it_looks_for() -> None:
    found = _strings(ast.parse("shots = {('humanoid', 'walk'): 1}").body[0].value.keys[0])  # pyright: ignore
    assert found & _NAMES == {"humanoid", "walk"}
    assert "Humanoid" in _classes()
