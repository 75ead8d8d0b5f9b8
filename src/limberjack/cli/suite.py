"""`limberjack list` and `gallery`: the tasks of the suite, and a picture of each."""

import dataclasses
import json as json_module
import math
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
    action_size: int
    observation_size: int


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
        sizes = str(task.action_size), str(task.observation_size)
        rows.add_row(task.domain, task.task, ", ".join(task.tags), *sizes)
    console().print(rows)


def _described(domain: str, task: str) -> _Task:
    from limberjack import suite

    factories = suite.module_of(domain).SUITE
    tags = [str(tag) for tag in factories.tags() if task in factories.tagged(tag)]
    if (domain, task) not in suite.BENCHMARKING:
        tags.append("extra")
    environment = suite.load(domain, task)
    action, observation = environment.action_spec(), environment.observation_spec()
    environment.close()
    sizes = (math.prod(spec.shape) for spec in observation.values())
    return _Task(domain, task, tags, math.prod(action.shape), sum(sizes))


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
