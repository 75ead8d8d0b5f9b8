"""Speed bars of batches in one table: against MuJoCo alone, EnvPool and Gymnasium's processes.

The tasks are those rich in contacts, which the planner plays; `suite_speed.py` measures all.

    python benchmarks/steps_per_second.py [--quick] [--only SECTION]... [--peers DIR] [--json FILE]

This script installs other packages, each in a separate virtual environment in DIR or in a temporary
folder. The exit status is 1 if a bar is missed. Missed bars are measured again at the end, and both
measurements are pooled.
"""

import dataclasses
import enum
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import batch_costs
import batch_peers
import batch_stepping
import typer
from peers import first_tasks
from report import Json, Peers, Quick, Row, Threads, WithoutPeers, finish, write_json

__all__ = ["Effort", "Section", "main"]


class Section(enum.StrEnum):
    """A part of the table."""

    STEP = "step"
    PROCESSES = "processes"
    RESET = "reset"
    THREADS = "threads"
    MEMORY = "memory"
    PIPELINING = "pipelining"


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    tasks: int = 10  # the first so many
    sizes: tuple[int, ...] = batch_stepping.SIZES  # numbers of rows
    seconds: float = 5  # for the rounds of each comparison
    rounds: int = 10  # of each comparison, at least
    warm_up_steps: int = 12  # before the rounds
    resets: int = 5  # of all rows, of each task
    tasks_of_domains: int = 3  # of which threads and pipelining are measured: one of each domain
    memory_rows: int = 4096
    pipelined_steps: int = 150  # of each loop
    pipelined_rounds: int = 3


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(
    tasks=1,
    sizes=(64,),
    seconds=0.01,
    rounds=2,
    warm_up_steps=1,
    resets=1,
    tasks_of_domains=1,
    memory_rows=8,
    pipelined_steps=2,
    pipelined_rounds=1,
)
_TASK_OF_DOMAIN = (("humanoid", "walk"), ("manipulator", "bring_ball"), ("stacker", "stack_4"))


def _measure(
    section: Section, effort: Effort, num_threads: int, peers: Path | None, versions: dict[str, str]
) -> list[Row]:
    """The rows of a section.

    Args:
      section: to measure.
      effort: see there.
      num_threads: of everything.
      peers: folder in which the peers are installed; None omits them.
      versions: receives those of the peers and of the MuJoCo that they run.
    """
    tasks, few_tasks = first_tasks()[: effort.tasks], _TASK_OF_DOMAIN[: effort.tasks_of_domains]
    match section:
        case Section.STEP:
            return _measure_steps(tasks, effort, num_threads, peers, versions)
        case Section.PROCESSES:
            folder = batch_peers.install(batch_peers.ASYNC, peers)
            if folder is None:
                return []
            given = effort.seconds, effort.rounds, versions
            return batch_stepping.measure_processes(tasks, num_threads, folder, *given)
        case Section.RESET:
            given = effort.resets, min(1.0, effort.seconds)
            return batch_costs.measure_resets(tasks, num_threads, *given)
        case Section.THREADS:
            return batch_costs.measure_threads(few_tasks, num_threads, 8 * effort.seconds)
        case Section.MEMORY:
            return batch_costs.measure_memory(effort.memory_rows)
        case Section.PIPELINING:
            given = effort.pipelined_steps, effort.pipelined_rounds
            return batch_costs.measure_pipelining(few_tasks, num_threads, *given)


def _measure_steps(
    tasks: Sequence[tuple[str, str]],
    effort: Effort,
    num_threads: int,
    peers: Path | None,
    versions: dict[str, str],
) -> list[Row]:
    folder = batch_peers.install(batch_peers.ENVPOOL, peers)
    cells = batch_stepping.Cells(tasks, effort.sizes, num_threads, folder)

    def measure(cell: batch_stepping.Cell, words: str = "") -> None:
        _say(f"  {words}{cell[0]}:{cell[1]}, N={cell[2]}")
        cells.measure(cell, effort.seconds, effort.rounds, effort.warm_up_steps)

    for cell in cells.all:
        measure(cell)
    for cell in cells.doubtful():  # under a different load
        measure(cell, "again: ")
    versions |= cells.versions
    return cells.rows()


def _say(line: str) -> None:
    typer.echo(line, err=True)


def main(
    only: Annotated[
        list[Section] | None, typer.Option(help="Measure this section; may be given repeatedly.")
    ] = None,
    quick: Quick = False,
    peers: Peers = None,
    without_peers: WithoutPeers = False,
    threads: Threads = None,
    json: Json = None,
) -> None:
    """Measure batches beside their peers and print each bar and whether it is met."""
    effort = _QUICK if quick else Effort()
    num_threads = threads or batch_costs.free_cores()
    rows: list[Row] = []
    versions: dict[str, str] = {}
    loads = {}
    with tempfile.TemporaryDirectory() as temporary:
        folder = None if without_peers else peers or Path(temporary)
        for section in only or list(Section):
            _say(f"measuring: {section}, {num_threads} threads")
            rows += _measure(section, effort, num_threads, folder, versions)
            if hasattr(os, "getloadavg"):
                loads[section.value] = os.getloadavg()
            if json is not None:  # after each section, as it takes long
                settings = {"quick": quick, "threads": num_threads, **dataclasses.asdict(effort)}
                write_json(json, rows, {**settings, "peers": versions, "load_averages": loads})
    for peer, engine in versions.items():
        typer.echo(f"{peer} runs {engine}")
    finish(rows, "compared", quick)  # the file is written


if __name__ == "__main__":
    typer.run(main)
