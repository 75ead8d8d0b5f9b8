"""`limberjack solve`: episodes of a task, played by the planner and recorded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    AnyProcessor,
    Domain,
    FirstSeed,
    Ray,
    Shard,
    TaskName,
    TimeLimit,
    Workers,
    named_task,
    seeds_from,
    shard_named,
)
from limberjack.cli.output import misuse_reported
from limberjack.cli.solving import Solving

if TYPE_CHECKING:
    from limberjack.workers import Scale

__all__: list[str] = []

_Threads = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="Threads that simulate one episode, in each worker. By default one episode is played "
        "per core, with one thread each.",
    ),
]


_Explain = Annotated[
    bool,
    typer.Option(
        help="Print the stages of each episode, and the terms of the plans' cost; report.html "
        "charts them. Plays in this process."
    ),
]


@command(
    "solve",
    "limberjack solve manipulator bring_ball --seed 3 --out solved",
    "limberjack solve humanoid/walk --episodes 100 --workers 8 --out solved",
)
def _solve(
    domain: Domain,
    task: TaskName = None,
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 1,
    seed: FirstSeed = 0,
    time_limit: TimeLimit = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write a recording of each episode, report.html, result.json, return.png and "
            "video.mp4 here; recordings that are there are not played again.",
        ),
    ] = None,
    threads: _Threads = None,
    workers: Workers = None,
    ray: Ray = None,
    shard: Shard = None,
    any_processor: AnyProcessor = False,
    explain: _Explain = False,
) -> None:
    """Play episodes of a task with the planner, which simulates the outcomes of its actions.

    It plans from the simulator's full state, not from observations. The same seed gives the same
    episode at any number of threads and workers. With --out each episode is recorded as it ends,
    for `limberjack replay`, and the same command continues where an earlier one was killed.
    """
    with misuse_reported():
        part, seeds = shard_named(shard, out), seeds_from(seed, episodes)
        if part is not None and not _seeds_of(part, seeds):
            typer.echo(f"shard {shard} has no episode: there are fewer blocks of 64 than shards")
            raise typer.Exit
        solving = Solving(
            *named_task(domain, task),
            seeds,
            _scale(workers, ray, threads, any_processor),
            out,
            time_limit=time_limit,
            shard=part,
            explain=explain,
        )
    raise typer.Exit(solving.finish())


def _seeds_of(shard: tuple[int, int], seeds: range) -> list[int]:
    from limberjack.workers import shard_of

    return shard_of(seeds, *shard)


def _scale(
    workers: int | None, ray: str | None, threads: int | None, any_processor: bool
) -> "Scale":
    from limberjack.workers import Scale

    return Scale(workers, None, ray, threads, any_processor)
