"""Arguments and options that several commands have, described in the same words."""

import re
from typing import Annotated

import typer

from limberjack import registry
from limberjack.utils.seeds import SEEDS
from limberjack.utils.suggest import did_you_mean

__all__ = [
    "ActionRepeat",
    "AnyProcessor",
    "Domain",
    "FirstSeed",
    "OptionalDomain",
    "PolicyName",
    "Ray",
    "Shard",
    "TaskName",
    "TimeLimit",
    "Workers",
    "named_task",
    "seeds_from",
    "seeds_of",
    "shard_named",
]

_DOMAIN = typer.Argument(
    metavar="DOMAIN",
    help="Such as humanoid; `limberjack list` shows all, `limberjack --import` adds one. "
    "DOMAIN/TASK, such as humanoid/walk, names both.",
    show_default=False,
)
Domain = Annotated[str, _DOMAIN]
OptionalDomain = Annotated[str | None, _DOMAIN]
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
ActionRepeat = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Control steps per action; the environment's own by default, mostly 1. Returns and "
        "lengths still count control steps.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Processes that play; one that dies is replaced. With --ray, episodes or batches of "
        "64 at a time. No number of workers changes a result.",
    ),
]
Ray = Annotated[
    str | None,
    typer.Option(
        metavar="[ADDRESS]",
        help="Play on a Ray cluster: its address, or none to start Ray on this machine.",
    ),
]
Shard = Annotated[
    str | None,
    typer.Option(
        metavar="K/N",
        help="Play the K-th of N parts of the seeds only, such as 3/8, as one task of a Slurm "
        "array does; the same command without it joins all parts.",
    ),
]
AnyProcessor = Annotated[
    bool,
    typer.Option(
        "--any-processor",
        help="Accept processors that round differently, and record which one played.",
    ),
]


def shard_named(shard: str | None, out: object) -> tuple[int, int] | None:
    """The numbers in K/N; None without a shard.

    Args:
      shard: as the option gives it.
      out: the folder of the results, which a shard must have.

    Raises:
      ValueError: it is something else, or there is no folder.
    """
    if shard is None:
        return None
    found = re.fullmatch(r"(\d+)/(\d+)", shard)
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise ValueError(f"--shard is {shard!r}; expected K/N with K from 1 to N, such as 3/8")
    if out is None:
        raise ValueError(f"--shard {shard} needs --out DIR, a folder that all shards write to")
    return int(found[1]), int(found[2])


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


def seeds_from(first: int, episodes: int) -> range:
    """The seeds of so many episodes, each one more than the one before.

    Raises:
      ValueError: the last one is too large.
    """
    seeds = range(first, first + episodes)
    if seeds[-1] >= SEEDS:
        raise ValueError(f"the last episode's seed is {seeds[-1]}; expected below {SEEDS}")
    return seeds


def seeds_of(given: str) -> range:
    """The seeds that A:B names.

    Raises:
      ValueError: it is no range, an empty one, or one of numbers that are too large.
    """
    found = re.fullmatch(r"(\d+):(\d+)", given)
    if found is None:
        raise ValueError(f"--seeds is {given!r}; expected A:B, such as 0:100 for the first hundred")
    seeds = range(int(found[1]), int(found[2]))
    if not seeds:
        raise ValueError(f"--seeds is {given}, which holds no seed; expected A:B with A below B")
    if seeds[-1] >= SEEDS:
        raise ValueError(f"--seeds is {given}; expected numbers up to {SEEDS}")
    return seeds
