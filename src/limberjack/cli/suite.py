"""`limberjack list` and `gallery`: the tasks of the suite, and a picture of each."""

import contextlib
import dataclasses
import json as json_module
from typing import Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import RequiredOut
from limberjack.cli.output import FAILED, complain, console, misuse_reported, table
from limberjack.cli.progress import show_parts

__all__: list[str] = []


@dataclasses.dataclass(frozen=True)
class _Task:
    """A task, as `--json` prints it."""

    domain: str
    task: str
    tags: list[str]
    action_size: int | None
    observation_size: int | None


@command("list", "limberjack list", "limberjack list --json")
def _list(
    json: Annotated[
        bool, typer.Option("--json", help="Print a JSON list of objects, one for each task.")
    ] = False,
) -> None:
    """List the tasks, their tags, and the sizes of actions and observations.

    Domains of installed packages are included, and those of modules given as `limberjack --import
    MODULE list`.
    """
    from limberjack import suite

    for name, problem in suite.find_installed().items():
        complain(f"domain {name!r} is left out: {problem}")
    tasks = [_described(domain, task) for domain, task in suite.tasks()]
    if json:
        typer.echo(json_module.dumps([dataclasses.asdict(task) for task in tasks], indent=2))
        return
    rows = table("domain", "task", "tags", "action>", "observation>")
    for task in tasks:
        sizes = ("?" if n is None else str(n) for n in (task.action_size, task.observation_size))
        rows.add_row(task.domain, task.task, ", ".join(task.tags), *sizes)
    console().print(rows)


def _described(domain: str, task: str) -> _Task:
    from limberjack import registry, suite
    from limberjack.suite._registration import sizes_of

    (row,) = [one for one in registry.domains()[domain].rows if one.task == task]
    tags = [*row.tags, *([] if (domain, task) in suite.BENCHMARKING else ["extra"])]
    sizes = row.actions, row.observations
    if None in sizes:  # of a domain that was assigned, whose models were not compiled
        with contextlib.closing(suite.load(domain, task)) as environment:
            sizes = sizes_of(environment)
    return _Task(domain, task, tags, *sizes)


@command("gallery", "limberjack gallery --out pictures")
def _gallery(
    out: RequiredOut,
) -> None:
    """Draw a picture of each task, and a sheet of all of them: suite.png."""
    from limberjack import gallery
    from limberjack.mujoco.camera import RenderingError

    with misuse_reported():
        try:
            with show_parts() as show:
                paths = gallery.write(
                    out,
                    on_progress=lambda domain, task, drawn, tasks: show(
                        f"drawing {domain} {task}", drawn, tasks
                    ),
                )
        except RenderingError as error:
            complain(f"no pictures: {error}")
            raise typer.Exit(FAILED) from None
    for path in paths:
        typer.echo(path)
