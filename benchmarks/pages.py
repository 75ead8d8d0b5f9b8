"""Text that benchmarks write into pages of docs/: tables, and sections between marks.

    lines = table(["task", "mean"], [["walker walk", "957.1"]])
    write_section(page, "threads", "threads.py", text)

A section begins with the line `<!-- NAME: written by benchmarks/SCRIPT -->`, and ends where the
page has `<!-- end -->`.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

__all__ = ["section_of", "table", "write_section"]

_END = "<!-- end -->"


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """The lines of a table in Markdown."""
    body = [f"| {' | '.join(row)} |" for row in rows]
    return [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|", *body]


def section_of(page: Path, name: str, script: str) -> str:
    """The text of a page between the mark of a name and the end."""
    return _parts(page, name, script)[1]


def write_section(page: Path, name: str, script: str, text: str) -> None:
    """Replaces the text of a page between the mark of a name and the end."""
    before, _, after = _parts(page, name, script)
    page.write_text(f"{before}{text}{after}", encoding="utf-8")


def _parts(page: Path, name: str, script: str) -> tuple[str, str, str]:
    """The page up to the mark, from there to the end, and the rest.

    Raises:
      ValueError: the page lacks the mark or the end.
    """
    mark = f"<!-- {name}: written by benchmarks/{script} -->\n"
    before, found, rest = page.read_text(encoding="utf-8").partition(mark)
    text, end, after = rest.partition(_END)
    if not found or not end:
        raise ValueError(f"{page.name} has no section between {mark.strip()} and {_END}: add them")
    return before + mark, text, end + after
