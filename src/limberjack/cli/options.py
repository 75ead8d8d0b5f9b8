"""Arguments and options that several commands have, described in the same words."""

from typing import Annotated

import typer

from limberjack.cli.output import SEEDS

__all__ = ["Domain", "FirstSeed", "PolicyName", "TaskName", "TimeLimit"]

Domain = Annotated[
    str,
    typer.Argument(
        metavar="DOMAIN",
        help="Such as humanoid; `limberjack list` has all, `limberjack --import` adds one.",
    ),
]
TaskName = Annotated[str, typer.Argument(metavar="TASK", help="Such as walk.")]
PolicyName = Annotated[
    str, typer.Option(metavar="NAME", help="What acts: zero, random, planner or MODULE:CALLABLE.")
]
FirstSeed = Annotated[
    int, typer.Option(min=0, max=SEEDS - 1, help="Of the first episode; the next has seed+1.")
]
TimeLimit = Annotated[
    float | None, typer.Option(help="Seconds per episode; the task's own by default.")
]
