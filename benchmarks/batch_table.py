"""The table of batches, whose second column differs from row to row."""

from collections.abc import Iterable

import report
from report import Row
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

__all__ = ["print_table"]

_WIDTH = 118  # characters; where the output is no terminal, the table is not folded


def print_table(rows: Iterable[Row]) -> None:
    """Prints the rows and whether each bar is met."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDTH)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for title in ("measure", "of"):
        table.add_column(title, no_wrap=True)
    for title in ("Limberjack", "compared", "result", "bar"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("met", no_wrap=True)
    measure = None
    for row in rows:
        if measure not in (None, row.measure):
            table.add_section()
        table.add_row(
            row.measure if row.measure != measure else "",
            row.subject,
            report._text(row.ours, row.unit),
            report._text(row.theirs, row.unit),
            report._text(row.value, row.value_unit),
            "" if row.bar is None else f"{row.bar} {row.value_unit}".strip(),
            report._verdict(row),
        )
        measure = row.measure
    console.print(table)
