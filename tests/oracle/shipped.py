"""Runs dm_control's own test files against Limberjack.

    cases = load_cases("rl.control_test")   # the unittest cases of rl/control_test.py, renamed
    print(run_case(cases["EnvironmentTest.test_timeout0"]))

A file is read from the installed dm_control, and its imports of `dm_control` become imports of
`limberjack` in memory; nothing is written. Only imports are renamed, in the syntax tree, so a text
that holds the word is left as it is. Three kinds of import become something else:

* test models, and the private layer that opens OpenGL contexts, stay dm_control's;
* names that Limberjack lacks become placeholders, so that the file's other cases run;
* the package `mock` becomes the standard library's module.
"""

import ast
import copy
import importlib
import importlib.util
import unittest
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .oracle import theirs

__all__ = ["Missing", "load_cases", "run_case"]

_ROOT = "dm_control"
_KEPT = ("dm_control.mujoco.testing", "dm_control._render")


class Missing:
    """Placeholder for a name that Limberjack lacks; using it raises an error."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"{self._name} is not built, so it has no {name!r}")


class _Renamed(ast.NodeTransformer):
    """Replaces imports from dm_control by imports from Limberjack."""

    def visit_Import(self, node: ast.Import) -> ast.stmt:
        if [name.name for name in node.names] == ["mock"]:
            return _statement("from unittest import mock")
        for name in node.names:
            assert name.name.split(".")[0] != _ROOT, "`import dm_control` would need its name too"
        return node

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.stmt | list[ast.stmt]:
        if (node.module or "").split(".")[0] != _ROOT:
            return node
        return [_renamed_import(node.module or "", name) for name in node.names]


def _renamed_import(module: str, name: ast.alias) -> ast.stmt:
    """One name imported from Limberjack, from dm_control if it is kept, or its placeholder."""
    if not f"{module}.{name.name}".startswith(_KEPT):
        module = "limberjack" + module.removeprefix(_ROOT)
        if not _is_there(module, name.name):
            missing = f"{module}.{name.name}"
            return _statement(f"{name.asname or name.name} = Missing({missing!r})")
    return ast.ImportFrom(module, [name], 0)


def _is_there(module: str, name: str) -> bool:
    try:
        found = importlib.import_module(module)
        return hasattr(found, name) or importlib.util.find_spec(f"{module}.{name}") is not None
    except ModuleNotFoundError:
        return False


def _statement(source: str) -> ast.stmt:
    return ast.parse(source).body[0]


def load_cases(name: str) -> dict[str, unittest.TestCase]:
    """The cases of the file of that name below dm_control, by `Class.method`."""
    root = Path(theirs("suite").__file__ or "").parents[1]
    path = root.joinpath(*name.split(".")).with_suffix(".py")
    tree = ast.fix_missing_locations(_Renamed().visit(ast.parse(path.read_text())))
    module = ModuleType(f"shipped.{name}")
    module.__dict__["Missing"] = Missing
    module.__file__ = str(path)
    exec(compile(tree, str(path), "exec"), module.__dict__)
    suite = unittest.defaultTestLoader.loadTestsFromModule(module)
    return {f"{type(case).__name__}.{case._testMethodName}": case for case in _flat(suite)}


def _flat(suite: Any) -> list[unittest.TestCase]:
    if isinstance(suite, unittest.TestCase):
        return [suite]
    return [case for part in suite for case in _flat(part)]


def run_case(case: unittest.TestCase) -> str:
    """Runs one case with its fixtures: the text of its failures, or "" if it passed."""
    result = unittest.TestResult()
    # rewards_test compares `x * x` with libm's `pow` at random values, and so it occasionally fails
    # with dm_control too.
    np.random.seed(0)
    # A copy: a case keeps what its `setUp` makes, such as a Physics.
    unittest.TestSuite([copy.copy(case)]).run(result)
    assert result.testsRun + len(result.skipped) >= 1
    return "\n".join(text for _, text in (*result.errors, *result.failures))
