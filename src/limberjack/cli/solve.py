"""`limberjack solve`: episodes of a task, played by the planner and kept."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    AnyProcessor,
    Appearance,
    EnvironmentName,
    Episodes,
    Faults,
    OptionalDomain,
    Out,
    Ray,
    Seeds,
    Shard,
    TaskName,
    Threads,
    TimeLimit,
    Workers,
    chosen_seeds,
    named_environment,
    shard_named,
    world_named,
)
from limberjack.cli.output import misuse_reported
from limberjack.cli.process import command_line
from limberjack.cli.progress import show_units
from limberjack.cli.run import finish

if TYPE_CHECKING:
    from limberjack.policies import Actor

__all__: list[str] = []

_PLANNER = "planner"

_Explain = Annotated[
    bool,
    typer.Option(
        help="Print the stages of each episode, and the terms of the plans' cost; report.html "
        "charts them. Plays in this process."
    ),
]


@command(
    "solve",
    "limberjack solve manipulator bring_ball --seeds 3 --out solved",
    "limberjack solve humanoid/walk --seeds 0:100 --workers 8 --out solved",
)
def _solve(
    domain: OptionalDomain = None,
    task: TaskName = None,
    env: EnvironmentName = None,
    seeds: Seeds = None,
    episodes: Episodes = None,
    out: Out = None,
    time_limit: TimeLimit = None,
    threads: Threads = None,
    workers: Workers = None,
    ray: Ray = None,
    shard: Shard = None,
    any_processor: AnyProcessor = False,
    faults: Faults = None,
    appearance: Appearance = None,
    explain: _Explain = False,
) -> None:
    """Play episodes of a task with the planner, which simulates the outcomes of its actions.

    It plans from the simulator's full state, not from observations, with the task's own model and
    without the faults of --faults. The same seed gives the same
    episode at any number of threads and workers; by default one episode is played per core. With
    --out it writes what `limberjack run` writes; each episode is kept as it ends, and the same
    command continues where an earlier one was killed.
    """
    with show_units() as progress:
        with misuse_reported():
            where = named_environment(domain, task, env, time_limit)
            world = world_named(env, faults, appearance)
            part, chosen = shard_named(shard, out), chosen_seeds(seeds, episodes, 1)
            from limberjack.episodes.running import Run
            from limberjack.workers import Scale, shard_of

            if part is not None and not shard_of(chosen, part):
                typer.echo(f"shard {shard} has no episode: there are fewer blocks than shards")
                raise typer.Exit
            explaining = _Explaining()
            run = Run(
                *where,
                _PLANNER,
                chosen,
                out=out,
                time_limit=time_limit,
                scale=Scale(workers, None, ray, threads, any_processor, progress.show_state),
                shard=part,
                actor=explaining.actor(where, time_limit, threads) if explain else None,
                world=world,
                command=command_line(),
            )
            explaining.run = run
        status = finish(run, progress, out)
    if part is not None and status == 0:
        typer.echo(
            f"shard {shard}: {run.count} episodes are in {out}; the same command without --shard "
            "joins all shards"
        )
    raise typer.Exit(status)


class _Explaining:
    """Prints a plan's cost each simulated second and in each new stage, and charts it."""

    def __init__(self) -> None:
        from limberjack.episodes.running import Run

        self.run: Run | None = None
        self._last: tuple[int, str] = (-1, "")

    def actor(
        self, where: tuple[object, str | None], time_limit: float | None, threads: int | None
    ) -> "Actor":
        """The planner, which reports its plans here."""
        import contextlib

        from limberjack import policies
        from limberjack.workers.factories import factory_of

        factory = factory_of(*where, time_limit)  # pyright: ignore[reportArgumentType]
        with contextlib.closing(factory.make(0)) as environment:
            return policies.planner(environment, threads, self._on_plan)

    def _on_plan(self, time: float, stage: str, terms: Mapping[str, float]) -> None:
        if self.run is not None:
            self.run.add_plan(time, stage, terms)
        if (int(time), stage) != self._last:
            self._last = int(time), stage
            listed = ", ".join(f"{name} {value:.3g}" for name, value in terms.items())
            typer.echo(f"{time:6.2f} s  {stage or 'plan'}: {listed}")
