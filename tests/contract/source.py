"""The package's source for the contract tests: modules, their syntax trees and their imports."""

import ast
import functools
from collections.abc import Iterator
from pathlib import Path

__all__ = ["PACKAGE", "REPOSITORY", "SOURCE", "imports", "is_public", "modules", "tree"]

PACKAGE = "limberjack"
REPOSITORY = Path(__file__).parents[2]
SOURCE = REPOSITORY / "src"


@functools.cache
def modules() -> dict[str, Path]:
    """The path of every module, by its full name."""
    found = {}
    for path in sorted((SOURCE / PACKAGE).rglob("*.py")):
        parts = path.relative_to(SOURCE).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@functools.cache
def tree(module: str) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


def is_public(module: str) -> bool:
    """Whether no part of a module's name begins with an underscore."""
    return not any(part.startswith("_") for part in module.split("."))


@functools.cache
def imports(module: str) -> tuple[str, ...]:
    """Full names of all modules that a module imports, also in functions and with `importlib`.

    A name imported from a package counts as its submodule if there is one, otherwise as the package
    itself.
    """
    return tuple(_imports(module))


def _imports(module: str) -> Iterator[str]:
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            source = _absolute(module, node)
            for alias in node.names:
                name = f"{source}.{alias.name}"
                yield name if name in modules() else source
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "importlib.import_module":
            name = node.args[0]
            if isinstance(name, ast.Constant) and isinstance(name.value, str):
                yield name.value


def _absolute(module: str, node: ast.ImportFrom) -> str:
    """The full name after `from`."""
    if not node.level:
        return node.module or ""
    parts = module.split(".")
    is_package = modules()[module].name == "__init__.py"
    kept = len(parts) - node.level + is_package
    return ".".join([*parts[:kept], *([node.module] if node.module else [])])
