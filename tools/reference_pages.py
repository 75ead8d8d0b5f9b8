"""Pages of the API reference: one for each module with public names, and an index of them.

    for name, text in reference_pages.pages().items(): ...

A page names its module to mkdocstrings, which reads the docstrings. Modules whose names, or whose
packages' names, begin with an underscore are private, and have no page.
"""

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import limberjack

__all__ = ["INDEX", "modules", "pages"]

_PACKAGE = limberjack.__name__
_SOURCE = Path(__file__).parents[1] / "src" / _PACKAGE
INDEX = "index.md"

_HEAD = """# API reference

Every public name, from its docstring. Names that begin with an underscore are private.
[Compatibility](../compatibility.md) says which of these modules are a promise; the others are
documented for those who change Limberjack.
"""


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
    """What a module lists in `__all__`."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return ast.literal_eval(node.value)
    return []


def pages() -> dict[str, str]:
    """The text of each page by its file's name."""
    found = modules()
    return {INDEX: _index(found), **{f"{name}.md": _page(name, found) for name in found}}


def _page(name: str, found: dict[str, Path]) -> str:
    exported = list(_exported(name, found))
    parts = [f"# {name}", *([_table(exported)] if exported else []), f"::: {name}"]
    return "\n\n".join(parts) + "\n"


def _exported(name: str, found: dict[str, Path]) -> Iterator[tuple[str, str]]:
    """The names that a package takes from its modules, each with the module that defines it."""
    if found[name].name != "__init__.py":
        return
    package = importlib.import_module(name)
    for public in _public_names(found[name]):
        home = getattr(getattr(package, public), "__module__", name)
        if home != name and home in found:
            yield public, home


def _table(exported: list[tuple[str, str]]) -> str:
    rows = [f"| `{name}` | [`{home}`]({home}.md) |" for name, home in exported]
    return "\n".join(["| name | defined in |", "|---|---|", *rows])


def _index(found: dict[str, Path]) -> str:
    rows = [f"| [`{name}`]({name}.md) | {_summary(path)} |" for name, path in found.items()]
    return "\n".join([_HEAD, "| module | contents |", "|---|---|", *rows]) + "\n"


def _summary(path: Path) -> str:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(text.partition("\n\n")[0].split()).replace("|", "\\|")
