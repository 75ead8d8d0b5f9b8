"""Pages of the API reference: one for each module with public names, and an index of them.

    for name, text in reference_pages.pages().items(): ...

A page names its module to mkdocstrings, which reads the docstrings. Modules whose names, or whose
packages' names, begin with an underscore are private, and have no page.
"""

import ast
import functools
import importlib
import inspect
from pathlib import Path

__all__ = ["INDEX", "modules", "pages"]

_PACKAGE = "limberjack"
_SOURCE = Path(__file__).parents[1] / "src" / _PACKAGE
INDEX = "index.md"

_HEAD = """# API reference

Every public name, from its docstring. Names that begin with an underscore are private.
[Compatibility](../compatibility.md) says which of these modules are a promise; the others are
documented for those who change Limberjack.
"""


@functools.cache  # each page with names from other modules asks again
def modules() -> dict[str, Path]:
    """The public modules by dotted name, packages before what is in them."""
    found = {}
    for path in sorted(_SOURCE.rglob("*.py")):
        parts = list(path.relative_to(_SOURCE).with_suffix("").parts)
        if parts[-1] == "__init__":
            parts.pop()
        if not any(part.startswith("_") for part in parts):
            found[".".join([_PACKAGE, *parts])] = path
    return {name: found[name] for name in sorted(found) if _public_names(found[name])}


def _public_names(path: Path) -> list[str]:
    """The names in a module's `__all__`."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return ast.literal_eval(node.value)
    return []


def pages() -> dict[str, str]:
    """The text of each page by its file's name."""
    found = modules()
    return {INDEX: _index(found), **{f"{name}.md": _page(name, found) for name in found}}


def _page(name: str, found: dict[str, Path]) -> str:
    others = [(other, _home(name, other, found)) for other in _not_defined_here(found[name])]
    parts = [f"# {name}", *([_table(others)] if others else []), f"::: {name}"]
    return "\n\n".join(parts) + "\n"


def _not_defined_here(path: Path) -> list[str]:
    """The public names for which mkdocstrings finds no definition in a module."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    defined = set()
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            defined.add(node.name)
        target = getattr(node, "target", None)  # of an annotated assignment
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target = node.targets[0]
        if isinstance(target, ast.Name):
            defined.add(target.id)
    return [name for name in _public_names(path) if name not in defined]


def _home(module: str, name: str, found: dict[str, Path]) -> str:
    """The module that another one takes a public name from, or the kind of value that it is."""
    try:
        value = getattr(importlib.import_module(module), name)
    except ImportError:  # of an extra that is not installed here
        return _source(name, found[module]) or name
    if inspect.ismodule(value):
        return value.__name__
    home = getattr(value, "__module__", "")
    return home if home in found else _source(name, found[module]) or type(value).__name__


def _source(name: str, path: Path) -> str | None:
    """The module that a file imports a name from."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
            return node.module
    return None


def _table(others: list[tuple[str, str]]) -> str:
    modules_ = modules()
    homes = {home: f"[`{home}`]({home}.md)" for _, home in others if home in modules_}
    rows = [f"| `{name}` | {homes.get(home, f'`{home}`')} |" for name, home in others]
    return "\n".join(["| name | defined in, or kind |", "|---|---|", *rows])


def _index(found: dict[str, Path]) -> str:
    rows = [f"| [`{name}`]({name}.md) | {_summary(path)} |" for name, path in found.items()]
    return "\n".join([_HEAD, "| module | contents |", "|---|---|", *rows]) + "\n"


def _summary(path: Path) -> str:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(text.partition("\n\n")[0].split()).replace("|", "\\|")
