"""dm_control's own test files, to be run against Limberjack.

    cases = load_cases("rl.control_test")     # the unittest cases of rl/control_test.py, renamed

A file is read from the installed dm_control, and its imports of `dm_control` become imports of
`limberjack` in memory; nothing is written. Only imports are renamed, in the syntax tree, so a text
that holds the word is left as it is. Three imports become something else:

* `dm_control.mujoco.testing.assets` stays dm_control's: it is a folder of test models;
* a domain that is not built becomes a placeholder, so that the file's other cases run;
* `mock`, a package of its own, becomes the standard library's.
"""

import ast
import importlib.util
import unittest
from pathlib import Path
from types import ModuleType
from typing import Any

from . import oracle

__all__ = ["NotBuilt", "load_cases", "run_case"]

_ROOT = "dm_control"
_KEPT = "dm_control.mujoco.testing"


class NotBuilt:
    """Stands for a domain that Limberjack does not have; using it is an error that says so."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"domain {self._name!r} is not built, so it has no {name!r}")


class _Renamed(ast.NodeTransformer):
    """Imports from Limberjack what was imported from dm_control."""

    def visit_Import(self, node: ast.Import) -> ast.stmt:
        if [name.name for name in node.names] == ["mock"]:
            return _statement("from unittest import mock")
        for name in node.names:
            assert name.name.split(".")[0] != _ROOT, "`import dm_control` would need its name too"
        return node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.stmt | list[ast.stmt]:
        module = node.module or ""
        if module.split(".")[0] != _ROOT or module.startswith(_KEPT):
            return node
        node.module = "limberjack" + module.removeprefix(_ROOT)
        if module != f"{_ROOT}.suite":
            return node
        return [_domain_import(node, name) for name in node.names]


def _domain_import(node: ast.ImportFrom, name: ast.alias) -> ast.stmt:
    """The import of one name from `limberjack.suite`, or a placeholder if it is not there."""
    if importlib.util.find_spec(f"limberjack.suite.{name.name}") is None:
        return _statement(f"{name.asname or name.name} = NotBuilt({name.name!r})")
    return ast.ImportFrom(node.module, [name], 0)


def _statement(source: str) -> ast.stmt:
    return ast.parse(source).body[0]


def load_cases(name: str) -> dict[str, unittest.TestCase]:
    """The cases of the file of that name below dm_control, by class and method."""
    root = Path(oracle.theirs("suite").__file__ or "").parents[1]
    path = root.joinpath(*name.split(".")).with_suffix(".py")
    tree = ast.fix_missing_locations(_Renamed().visit(ast.parse(path.read_text())))
    module = ModuleType(f"shipped.{name}")
    module.__dict__["NotBuilt"] = NotBuilt
    module.__file__ = str(path)
    exec(compile(tree, str(path), "exec"), module.__dict__)
    suite = unittest.defaultTestLoader.loadTestsFromModule(module)
    return {case.id().removeprefix(f"{module.__name__}."): case for case in _flat(suite)}


def _flat(suite: Any) -> list[unittest.TestCase]:
    if isinstance(suite, unittest.TestCase):
        return [suite]
    return [case for part in suite for case in _flat(part)]


def run_case(case: unittest.TestCase) -> str:
    """Runs one case with its fixtures: the failures' text, or "" if it passed."""
    result = unittest.TestResult()
    unittest.TestSuite([case]).run(result)
    assert result.testsRun == 1
    return "\n".join(text for _, text in (*result.errors, *result.failures))
