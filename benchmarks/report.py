"""Rows and bars of benchmarks, and their output as a table and as JSON."""

import dataclasses
import datetime
import importlib
import importlib.metadata
import os
import platform
import statistics
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NoReturn

import sources
import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

__all__ = [
    "Bar",
    "Json",
    "Peers",
    "Quick",
    "Row",
    "Threads",
    "WithoutPeers",
    "at_least",
    "at_most",
    "compared",
    "figure",
    "finish",
    "mean_of",
    "rates",
    "spread",
    "versions",
    "write_json",
]

# Options that the benchmarks have in common.
Quick = Annotated[
    bool, typer.Option("--quick", help="Only show that it works; the figures mean nothing.")
]
Json = Annotated[Path | None, typer.Option(help="File to write the figures to.")]
Peers = Annotated[
    Path | None, typer.Option(metavar="DIR", help="Where other packages are installed, kept.")
]
WithoutPeers = Annotated[
    bool, typer.Option("--without-peers", help="Install and compare with nothing.")
]
Threads = Annotated[
    int | None, typer.Option(min=1, help="Of everything; by default the cores now free.")
]

_MEASURED = ("limberjack", "dm_control", "mujoco", "mujoco-core", "dm-env", "numpy")
_WIDTH = 118  # characters; where the output is no terminal, the table is not folded


@dataclasses.dataclass(frozen=True)
class Bar:
    """A limit that a figure must meet."""

    limit: float
    is_maximum: bool

    def is_met_by(self, value: float) -> bool:
        """Whether a figure meets the bar."""
        return value <= self.limit if self.is_maximum else value >= self.limit

    def __str__(self) -> str:
        return f"{'<=' if self.is_maximum else '>='} {self.limit:g}"


def at_least(limit: float) -> Bar:
    """The bar of a figure that must be `limit` or more."""
    return Bar(limit, is_maximum=False)


def at_most(limit: float) -> Bar:
    """The bar of a figure that must be `limit` or less."""
    return Bar(limit, is_maximum=True)


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of the table.

    A row without a `value` had nothing to compare with; one without a `bar` is for information.
    """

    measure: str
    subject: str
    ours: float | None
    theirs: float | None
    unit: str  # of `ours` and `theirs`
    value: float | None  # the figure compared with the bar
    value_unit: str = ""
    bar: Bar | None = None
    details: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def is_met(self) -> bool | None:
        """Whether the bar is met; None if there is none or nothing was measured."""
        if self.bar is None or self.value is None:
            return None
        return self.bar.is_met_by(self.value)


def spread(values: Sequence[float]) -> dict[str, float]:
    """Median, quartiles and number of repeated measurements."""
    if len(values) < 2:
        return {"median": values[0], "count": len(values)}
    lower, _, upper = statistics.quantiles(values, n=4, method="inclusive")
    median = statistics.median(values)
    return {"median": median, "quartile_1": lower, "quartile_3": upper, "count": len(values)}


def figure(
    measure: str,
    subject: str,
    value: float | None,
    unit: str,
    bar: Bar | None = None,
    details: Mapping[str, Any] | None = None,
) -> Row:
    """The row of a figure that is compared with nothing but its bar."""
    return Row(measure, subject, value, None, unit, value, unit, bar, details or {})


def compared(
    measure: str,
    subject: str,
    ours: Sequence[float],
    theirs: Sequence[float],
    unit: str,
    bar: Bar | None = None,
    details: Mapping[str, Any] | None = None,
) -> Row:
    """The row of two quantities, measured in turns: the median of their ratios, ours / theirs.

    Args:
      measure: what is compared.
      subject: of what.
      ours: Limberjack's, by round.
      theirs: of the same rounds; empty if there is nothing to compare with.
      unit: of both.
      bar: on the ratio.
      details: more of them than the spread of the ratios.
    """
    if not theirs:
        return Row(measure, subject, statistics.median(ours), None, unit, None, bar=bar)
    ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
    medians = statistics.median(ours), statistics.median(theirs), unit, statistics.median(ratios)
    more = {"ratio": spread(ratios), **(details or {})}
    return Row(measure, subject, *medians, bar=bar, details=more)


def rates(seconds: Sequence[float], work: float = 1.0) -> list[float]:
    """Work per second of each round, from the seconds that it took."""
    return [work / each for each in seconds]


def mean_of(rows: Sequence[Row], subject: str, bar: Bar | None = None) -> Row:
    """The row of the geometric means of rows of one measure; without a value if a row has none."""
    columns = [(row.ours, row.theirs, row.value) for row in rows]
    ours, theirs, value = (
        None if None in column else statistics.geometric_mean(column)
        for column in zip(*columns, strict=True)
    )
    return Row(rows[0].measure, subject, ours, theirs, rows[0].unit, value, bar=bar)


def _print_table(rows: Iterable[Row], peer: str) -> None:
    """Prints the rows and whether each bar is met.

    Args:
      rows: the lines, grouped by measure.
      peer: title of the column of the package that Limberjack is compared with.
    """
    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDTH)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for title in ("measure", "of"):
        table.add_column(title, no_wrap=True)
    for title in ("Limberjack", peer, "result", "bar"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("met", no_wrap=True)
    measure = None
    for row in rows:
        if measure not in (None, row.measure):
            table.add_section()
        table.add_row(
            row.measure if row.measure != measure else "",
            row.subject,
            _text(row.ours, row.unit),
            _text(row.theirs, row.unit),
            _text(row.value, row.value_unit),
            "" if row.bar is None else f"{row.bar} {row.value_unit}".strip(),
            _verdict(row),
        )
        measure = row.measure
    console.print(table)


def finish(
    rows: Sequence[Row],
    peer: str,
    quick: bool = False,
    json: Path | None = None,
    settings: Mapping[str, Any] | None = None,
) -> NoReturn:
    """Prints the rows and their bars, writes the file if one is given, and exits.

    Args:
      rows: the lines, grouped by measure.
      peer: title of the column of what Limberjack is compared with.
      quick: whether the figures mean nothing, so that no bar is missed.
      json: file for the rows.
      settings: other settings for the file.

    Raises:
      SystemExit: always; the status is 1 if a bar is missed.
    """
    _print_table(rows, peer)
    typer.echo("quick: the figures mean nothing" if quick else _summary(rows))
    if json is not None:
        write_json(json, rows, {"quick": quick, **(settings or {})})
    sys.exit(not quick and any(row.is_met is False for row in rows))


def _summary(rows: Iterable[Row]) -> str:
    """The number of bars met, and the names of those missed."""
    with_bar = [row for row in rows if row.bar is not None]
    lines = [f"{sum(row.is_met is True for row in with_bar)} of {len(with_bar)} bars met"]
    lines += [f"missed: {row.measure}, {row.subject}" for row in with_bar if row.is_met is False]
    unmeasured = sum(row.is_met is None for row in with_bar)
    return "\n".join([*lines, f"{unmeasured} not measured"] if unmeasured else lines)


def write_json(path: Path, rows: Iterable[Row], settings: Mapping[str, Any]) -> None:
    """Writes the rows with the versions and the machine; no name or path of this machine."""
    document = {
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": _machine(),
        "versions": versions(),
        "settings": settings,
        "rows": [{**dataclasses.asdict(row), "is_met": row.is_met} for row in rows],
    }
    sources.write(path, document)


def _text(number: float | None, unit: str) -> str:
    if number is None:
        return ""
    digits = max(0, 2 - len(str(int(abs(number)))) + 1)
    return f"{number:,.{digits}f} {unit}".strip()


def _verdict(row: Row) -> str:
    if row.bar is None:
        return ""
    return {True: "[green]yes[/]", False: "[bold red]NO[/]", None: "not measured"}[row.is_met]


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that figures depend on."""
    found = {"python": platform.python_version()}
    for name in _MEASURED:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    if "limberjack" not in found:  # run from its source
        found["limberjack"] = importlib.import_module("limberjack").__version__
    return found


def _machine() -> dict[str, Any]:
    usable = getattr(os, "sched_getaffinity", None)
    load = getattr(os, "getloadavg", None)
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "system": platform.system(),
        "cores": os.cpu_count(),
        "usable_cores": len(usable(0)) if usable else os.cpu_count(),
        "load_average": load()[0] if load else None,  # of the last minute; this run is 1 of it
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
