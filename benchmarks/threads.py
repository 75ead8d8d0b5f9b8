"""Steps per second by number of threads: alone, with a policy and with learning, beside EnvPool.

    python benchmarks/threads.py [--quick] [--num-envs N] [--seconds S] [--json FILE]

It measures a heavy task, a lighter one and a toy as `limberjack bench` does, in all three columns,
and prints one row for each cell. With the file `results/threads.json` it writes the table of
docs/batches.md too. It needs the extra `train`, and EnvPool for its column. There are no bars.
"""

import json as json_of
from pathlib import Path
from typing import Annotated, Any

import pages
import sources
import typer
from report import Json, Quick, Row, finish, write_json

from limberjack import bench

__all__ = ["MARK", "PAGE", "RESULT", "main", "section", "write_page"]

_ROOT = Path(__file__).parents[1]
RESULT = sources.RESULTS / "threads.json"
PAGE = _ROOT / "docs" / "batches.md"
MARK = "threads", "threads.py"  # of the section
_TASKS = (("humanoid", "walk"), ("walker", "walk"), ("cartpole", "swingup"))
_ENVPOOL = "EnvPool"


def section(content: Any) -> str:  # Any: what was read from JSON
    """The table of the page, and the machine that it was measured on."""
    machine, settings = content["machine"], content["settings"]
    head = (
        f"Steps per second of {settings['num_envs']} rows, on {machine['usable_cores']} cores "
        f"({machine['processor']}):"
    )
    lines = []
    found: dict[str, dict[str, Any]] = {}
    for row in content["rows"]:
        found.setdefault(row["subject"], {})[row["measure"]] = row
    for subject, cells in found.items():
        task, _, threads = subject.rpartition(", ")
        speeds = [f"{cells[name]['ours']:,.0f}" for name in bench.COLUMNS]
        details, theirs = cells["step"]["details"], cells["step"]["theirs"]
        more = [f"{details['milliseconds_95']:.2f} ms", f"{details['megabytes']:.0f} MB"]
        envpool = "-" if theirs is None else f"{theirs:,.0f}"
        lines.append([task, threads.split()[0], *speeds, *more, envpool])
    columns = ["task", "threads", *bench.COLUMNS, "p95 of a step", "memory", _ENVPOOL]
    return "\n".join(["", head, "", *pages.table(columns, lines), "", ""])


def write_page() -> None:
    """Writes the table of the results into the page."""
    content = json_of.loads(RESULT.read_text(encoding="utf-8"))
    pages.write_section(PAGE, *MARK, section(content))


def _rows(domain: str, task: str, num_envs: int, seconds: float) -> list[Row]:
    """A row for each number of threads and column."""
    result = bench.measure(domain, task, num_envs, seconds=seconds, columns=bench.COLUMNS)
    if result.missing:
        raise SystemExit("; ".join(f"{name}: {why}" for name, why in result.missing.items()))
    theirs = {row.num_threads: row.cells["step"] for row in result.rows if row.what != bench.OURS}
    rows = []
    for row in (one for one in result.rows if one.what == bench.OURS):
        for column, cell in row.cells.items():
            other = theirs.get(row.num_threads) if column == "step" else None
            rows.append(
                Row(
                    column,
                    f"{domain} {task}, {row.num_threads} threads",
                    cell.steps_per_second,
                    None if other is None else other.steps_per_second,
                    "steps/s",
                    None if other is None else cell.ratio / other.ratio,
                    details={
                        "ratio_to_fewest_threads": cell.ratio,
                        "milliseconds_95": 1e3 * cell.seconds_95,
                        "megabytes": row.megabytes,
                        "recommended_threads": result.recommended_threads[column],
                    },
                )
            )
    return rows


def main(
    quick: Quick = False,
    num_envs: Annotated[int, typer.Option(min=2, help="Rows of each batch.")] = 64,
    seconds: Annotated[float, typer.Option(min=0.01, help="Of each column.")] = 10.0,
    json: Json = None,
) -> None:
    """Measure steps per second by number of threads, and print them beside EnvPool's."""
    if quick:
        num_envs, seconds = 2, 0.01
    rows = []
    for domain, task in _TASKS[-1:] if quick else _TASKS:
        typer.echo(f"measuring: {domain} {task}", err=True)
        rows += _rows(domain, task, num_envs, seconds)
    if json is not None:
        settings = {"quick": quick, "num_envs": num_envs, "seconds": seconds}
        write_json(json, rows, settings)
        if json.resolve() == RESULT:
            write_page()
    finish(sorted(rows, key=lambda row: bench.COLUMNS.index(row.measure)), _ENVPOOL, quick)


if __name__ == "__main__":
    typer.run(main)
