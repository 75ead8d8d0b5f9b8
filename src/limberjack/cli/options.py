"""Arguments and options that several commands have, described in the same words."""

from typing import Annotated

import typer

from limberjack import registry
from limberjack.utils.seeds import SEEDS
from limberjack.utils.suggest import did_you_mean

__all__ = ["Domain", "FirstSeed", "PolicyName", "TaskName", "TimeLimit", "named_task"]

Domain = Annotated[
    str,
    typer.Argument(
        metavar="DOMAIN",
        help="Such as humanoid; `limberjack list` shows all, `limberjack --import` adds one. "
        "DOMAIN/TASK, such as humanoid/walk, names both.",
    ),
]
TaskName = Annotated[
    str | None,
    typer.Argument(metavar="TASK", help="Such as walk.", show_default=False),
]
PolicyName = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="What acts: zero, random, planner, MODULE:CALLABLE, or sb3:PATH of a saved model.",
    ),
]
FirstSeed = Annotated[
    int, typer.Option(min=0, max=SEEDS - 1, help="Of the first episode; the next has seed+1.")
]
TimeLimit = Annotated[
    float | None, typer.Option(help="Seconds per episode; the task's own by default.")
]


def named_task(domain: str, task: str | None) -> tuple[str, str]:
    """The domain and the task that DOMAIN TASK or DOMAIN/TASK names; neither is looked up.

    Raises:
      ValueError: the task is missing or named twice.
    """
    first, slash, second = domain.partition("/")
    if slash and task is not None:
        raise ValueError(f"got {domain} and {task}; expected DOMAIN TASK or DOMAIN/TASK")
    if task is not None:
        return domain, task
    if slash:
        return first, second
    known = registry.domains()
    if domain not in known:
        raise ValueError(
            f"got {domain} without a task; expected DOMAIN TASK or DOMAIN/TASK."
            f"{did_you_mean(domain, known)} `limberjack list` shows all."
        )
    tasks = ", ".join(sorted(row.task for row in known[domain].rows))
    raise ValueError(f"got {domain} without a task; choose one of: {tasks}")
