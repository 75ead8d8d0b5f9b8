"""Tables of returns: a row for each policy or dataset, and one for each kind of start.

rows = summaries_table("policy")
add_summaries(rows, "zero", summary, strata)
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import rich.table

from limberjack.cli.output import table, visible

if TYPE_CHECKING:
    from limberjack.evaluation import Summary

__all__ = ["add_summaries", "summaries_table"]


def summaries_table(what: str) -> rich.table.Table:
    """An empty table, whose first column has this title."""
    return table(what, "start", "episodes>", "mean>", "95 % interval>", "median>", "success>")


def add_summaries(
    rows: rich.table.Table, name: str, summary: "Summary", strata: "Mapping[str, Summary]"
) -> None:
    """Adds the row of all episodes, and one for each kind of start."""
    rows.add_row(visible(name), "", *_cells(summary))
    for start, of_start in strata.items():
        rows.add_row("", visible(start), *_cells(of_start))
    rows.add_section()


def _cells(summary: "Summary") -> tuple[str, ...]:
    interval = ""
    if summary.interval is not None:
        interval = "{:.1f} to {:.1f}".format(*summary.interval)
    return (
        str(summary.episodes),
        f"{summary.mean:.1f}",
        interval,
        f"{summary.median:.1f}",
        f"{100 * summary.success_rate:.1f} %",
    )
