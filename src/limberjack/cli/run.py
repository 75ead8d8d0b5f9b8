"""`limberjack run`: episodes of a task, their returns and, with --out, a report on them.

`finish` is the part that `limberjack solve` shares: it plays the episodes, writes their files, and
prints their returns.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    ActionRepeat,
    Appearance,
    EnvironmentName,
    Episodes,
    Faults,
    OptionalDomain,
    Out,
    PolicyName,
    Seeds,
    TaskName,
    Threads,
    TimeLimit,
    Vectorised,
    chosen_seeds,
    named_environment,
    world_named,
)
from limberjack.cli.output import (
    FAILED,
    complain,
    console,
    failures_reported,
    misuse_reported,
    remarks_reported,
    search_working_directory,
    table,
)
from limberjack.cli.process import command_line
from limberjack.cli.progress import Units, show_parts, show_units

if TYPE_CHECKING:
    from limberjack.episodes import Episode
    from limberjack.episodes.running import Run

__all__ = ["finish"]


@command(
    "run",
    "limberjack run humanoid walk --policy random --episodes 3",
    "limberjack run humanoid/walk --policy sb3:walk.zip --out demo",
    "limberjack run --env my_package:make --policy my_policies:Still",
)
def _run(
    domain: OptionalDomain = None,
    task: TaskName = None,
    env: EnvironmentName = None,
    policy: PolicyName = "zero",
    seeds: Seeds = None,
    episodes: Episodes = None,
    out: Out = None,
    time_limit: TimeLimit = None,
    action_repeat: ActionRepeat = None,
    threads: Threads = None,
    vectorised: Vectorised = None,
    faults: Faults = None,
    appearance: Appearance = None,
) -> None:
    """Run episodes of a task and show their returns.

    Each episode is the first one of an environment with its own seed, so any of them can be run
    again alone. With --out it writes report.html, result.json, return.png, a video of the first
    episode and the steps of all, in the place of those of an earlier run of the same task and
    policy.

    A policy of your own, MODULE:CALLABLE, is a function from an observation (a dictionary of
    arrays) to an action, or a class with act(observation) and, if it needs it, reset(). Its module
    may be in the working directory.
    """
    with remarks_reported(), show_units() as progress:
        with misuse_reported():
            where = named_environment(domain, task, env, time_limit)
            search_working_directory(policy)
            from limberjack.episodes.running import Run
            from limberjack.workers import Scale

            run = Run(
                *where,
                policy,
                chosen_seeds(seeds, episodes, 1),
                out=out,
                time_limit=time_limit,
                action_repeat=action_repeat,
                scale=Scale(
                    num_threads=threads, on_state=progress.show_state, vectorised=vectorised
                ),
                replaces=True,
                world=world_named(env, faults, appearance),
                command=command_line(),
            )
        status = finish(run, progress, out)
    raise typer.Exit(status)


def finish(run: "Run", progress: Units, out: Path | None) -> int:
    """Plays, writes and prints; returns the exit status.

    Raises:
      typer.Exit: an error or interrupt ended the run; it was reported.
      Exception: any other error.
    """
    failure: BaseException | None = None
    progress.begin(run.count)
    try:
        run.play(progress.show)
    except BaseException as error:  # Ctrl-C too: finished episodes are kept
        failure = error
    progress.close()
    if failure is not None and progress.finished is None:
        with failures_reported(progress, lambda: "no episode was played"):
            raise failure
    unwritten = _written(run)  # first, because printing to a closed pipe fails
    _print_episodes(run.episodes)
    for line in run.left_out:
        complain(line)
    for path in run.written:
        typer.echo(path)
    if isinstance(unwritten, OSError):
        complain(unwritten)
    elif failure is None:
        failure = unwritten
    if failure is not None:
        done = f"{len(run.episodes)} of {run.count} episodes finished"
        if run.keeps:
            done += f"; what is kept in {out} is not played again"
        with failures_reported(progress, lambda: done):
            raise failure
    return FAILED if unwritten is not None or _complain_of_divergence(run.episodes) else 0


def _written(run: "Run") -> OSError | KeyboardInterrupt | None:
    """Writes the files, if any; returns the error or interrupt that ended that."""
    try:
        with show_parts() as show:
            run.write(lambda steps, all_steps: show("drawing", steps, all_steps))
    except (OSError, KeyboardInterrupt) as error:
        return error
    return None


def _complain_of_divergence(episodes: "list[Episode]") -> bool:
    diverged = [episode for episode in episodes if episode.diverged]
    for episode in diverged:
        complain(f"the simulation of seed {episode.seed} diverged in step {episode.length}")
    return bool(diverged)


def _print_episodes(episodes: "list[Episode]") -> None:
    with_start = any(episode.start is not None for episode in episodes)
    rows = table("seed>", *(["start"] if with_start else []), "return>", "steps>")
    for episode in episodes:
        start = [str(episode.start)] if with_start else []
        rows.add_row(str(episode.seed), *start, f"{episode.total:.3f}", str(episode.length))
    if len(episodes) > 1:
        totals = [episode.total for episode in episodes]
        mean = sum(totals) / len(totals)
        rows.add_section()
        rows.add_row("mean", *([""] if with_start else []), f"{mean:.3f}", "")
    if episodes:
        console().print(rows)
