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
from pathlib import Path
from typing import Annotated

import batch_costs
import batch_peers
import batch_stepping
import typer
from peers import first_tasks
from report import Json, Quick, Row, finish, write_json

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
    """The amount of work."""

    tasks: int  # the first so many
    sizes: tuple[int, ...]  # numbers of rows
    seconds: float  # for the rounds of each comparison
    rounds: int  # of each comparison, at least
    warm_up_steps: int  # before the rounds
    resets: int  # of all rows, of each task
    tasks_of_domains: int  # of which threads and pipelining are measured: one of each domain
    memory_rows: int
    pipelined_steps: int  # of each loop
    pipelined_rounds: int


_FULL = Effort(
    tasks=10,
    sizes=batch_stepping.SIZES,
    seconds=5,
    rounds=10,
    warm_up_steps=12,
    resets=5,
    tasks_of_domains=3,
    memory_rows=4096,
    pipelined_steps=150,
    pipelined_rounds=3,
)
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


class _Run:
    """One run of the benchmark."""

    def __init__(self, effort: Effort, num_threads: int, peers: Path | None) -> None:
        """Args: peers: folder in which the peers are installed; None omits them."""
        self._effort = effort
        self._num_threads = num_threads
        self._tasks = first_tasks()[: effort.tasks]
        self._few_tasks = _TASK_OF_DOMAIN[: effort.tasks_of_domains]
        self._peers = peers
        self.versions: dict[str, str] = {}  # of the peers and of the MuJoCo that they run

    def measure(self, section: Section) -> list[Row]:
        """The rows of a section."""
        effort, threads = self._effort, self._num_threads
        match section:
            case Section.STEP:
                return self._measure_steps()
            case Section.PROCESSES:
                return self._measure_processes()
            case Section.RESET:
                return batch_costs.measure_resets(
                    self._tasks, threads, effort.resets, min(1.0, effort.seconds)
                )
            case Section.THREADS:
                return batch_costs.measure_threads(self._few_tasks, threads, 8 * effort.seconds)
            case Section.MEMORY:
                return batch_costs.measure_memory(effort.memory_rows)
            case Section.PIPELINING:
                return batch_costs.measure_pipelining(
                    self._few_tasks, threads, effort.pipelined_steps, effort.pipelined_rounds
                )

    def _measure_steps(self) -> list[Row]:
        effort = self._effort
        folder = self._installed(batch_peers.ENVPOOL)
        cells = batch_stepping.Cells(self._tasks, effort.sizes, self._num_threads, folder)
        for cell in cells.all:
            _say(f"  {cell[0]}:{cell[1]}, N={cell[2]}")
            cells.measure(cell, effort.seconds, effort.rounds, effort.warm_up_steps)
        for cell in cells.doubtful():  # under a different load
            _say(f"  again: {cell[0]}:{cell[1]}, N={cell[2]}")
            cells.measure(cell, effort.seconds, effort.rounds, effort.warm_up_steps)
        self.versions |= cells.versions
        return cells.rows()

    def _measure_processes(self) -> list[Row]:
        folder = self._installed(batch_peers.ASYNC)
        if folder is None:
            return []
        return batch_stepping.measure_processes(
            self._tasks,
            self._num_threads,
            folder,
            self._effort.seconds,
            self._effort.rounds,
            self.versions,
        )

    def _installed(self, peer: str) -> Path | None:
        if self._peers is None:
            return None
        folder = batch_peers.install(peer, self._peers)
        if folder is None:
            _say(f"{peer} could not be installed: comparisons with it are not measured")
        return folder


def _say(line: str) -> None:
    typer.echo(line, err=True)


def main(
    only: Annotated[
        list[Section] | None, typer.Option(help="Measure this section; may be given repeatedly.")
    ] = None,
    quick: Quick = False,
    peers: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where other packages are installed, kept.")
    ] = None,
    without_peers: Annotated[
        bool, typer.Option("--without-peers", help="Install and compare with nothing.")
    ] = False,
    threads: Annotated[
        int | None, typer.Option(min=1, help="Of everything; by default the cores now free.")
    ] = None,
    json: Json = None,
) -> None:
    """Measure batches beside their peers and print each bar and whether it is met."""
    effort = _QUICK if quick else _FULL
    num_threads = threads or batch_costs.free_cores()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = None if without_peers else peers or Path(temporary)
        run = _Run(effort, num_threads, folder)
        loads = {}
        for section in only or list(Section):
            _say(f"measuring: {section}, {num_threads} threads")
            rows += run.measure(section)
            if hasattr(os, "getloadavg"):
                loads[section.value] = os.getloadavg()
            if json is not None:  # after each section, as it takes long
                settings = {"quick": quick, "threads": num_threads, **dataclasses.asdict(effort)}
                write_json(json, rows, {**settings, "peers": run.versions, "load_averages": loads})
    for peer, engine in run.versions.items():
        typer.echo(f"{peer} runs {engine}")
    finish(rows, "compared", quick)  # the file is written


if __name__ == "__main__":
    typer.run(main)
