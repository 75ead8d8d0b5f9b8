"""Limberjack's speed bars in one table, measured against dm_control in one run.

    python benchmarks/overhead.py [--quick] [--only SECTION]... [--json FILE]

The tasks are those rich in contacts, for which the bars were set; `suite_speed.py` measures all.
README.md describes the comparisons. The exit status is 1 if a bar is missed.
"""

import dataclasses
import enum
from typing import Annotated

import memory
import mixed_keys
import peers
import starting
import stepping
import typer
from report import Json, Quick, Row, finish

__all__ = ["Effort", "Section", "main"]


class Section(enum.StrEnum):
    """A part of the table."""

    STEP = "step"
    KEYS = "keys"
    IMPORT = "import"
    LOAD = "load"
    RESET = "reset"
    MEMORY = "memory"


@dataclasses.dataclass(frozen=True)
class Effort:
    """The amount of work; by default that of a full run."""

    tasks: int = 10  # the first so many
    episodes: int = 8  # of each task, by each package and by MuJoCo alone
    steps: int = 1_000  # of each episode
    resets: int = 400  # of each task, by each package
    loads: int = 21  # of each task, by each package
    processes: int = 15  # for each figure that takes a fresh one
    domains: int = 3  # of which a task is measured in fresh processes
    memory_steps: int = memory.NUM_STEPS  # in all
    memory_loads: int = memory.NUM_LOADS  # in all
    memory_cycles: int = memory.NUM_CYCLES  # in all


# Only checks that the benchmark works; its figures are meaningless.
_QUICK = Effort(
    tasks=2,
    episodes=1,
    steps=10,
    resets=2,
    loads=1,
    processes=1,
    domains=1,
    memory_steps=100,
    memory_loads=10,
    memory_cycles=3,
)


def _measure(section: Section, effort: Effort) -> list[Row]:
    tasks = peers.first_tasks()[: effort.tasks]
    match section:
        case Section.STEP:
            return stepping.measure(tasks, effort.episodes, effort.steps)
        case Section.KEYS:
            return mixed_keys.measure(effort.episodes, effort.steps)
        case Section.IMPORT:
            return starting.measure_imports(effort.processes)
        case Section.LOAD:
            return starting.measure_loads(tasks, effort.loads, effort.processes, effort.domains)
        case Section.RESET:
            return starting.measure_resets(tasks, effort.resets)
        case Section.MEMORY:
            counts = effort.memory_steps, effort.memory_loads, effort.memory_cycles
            return memory.measure(*counts, effort.domains)


def main(
    only: Annotated[
        list[Section] | None, typer.Option(help="Measure this section; may be given repeatedly.")
    ] = None,
    quick: Quick = False,
    json: Json = None,
) -> None:
    """Measure Limberjack against dm_control and print each bar and whether it is met."""
    effort = _QUICK if quick else Effort()
    if peers.THEIRS not in peers.installed():
        typer.echo(
            "dm_control is not installed (it does not support Python 3.13 and newer): comparisons "
            "with it are not measured.",
            err=True,
        )
    rows = []
    for section in only or list(Section):
        typer.echo(f"measuring: {section}", err=True)
        rows += _measure(section, effort)
    finish(rows, "dm_control", quick, json, dataclasses.asdict(effort))


if __name__ == "__main__":
    typer.run(main)
