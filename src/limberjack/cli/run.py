"""`limberjack run`: episodes of a task, their returns and, with --out, a report on them."""

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    ActionRepeat,
    EnvironmentName,
    Episodes,
    OptionalDomain,
    Out,
    PolicyName,
    Seeds,
    TaskName,
    Threads,
    TimeLimit,
    Vectorised,
    chosen_seeds,
    finite,
    named_environment,
)
from limberjack.cli.output import misuse_reported, remarks_reported, search_working_directory
from limberjack.cli.progress import show_units
from limberjack.cli.running import finish, scale_of
from limberjack.cli.typed import command_line

__all__: list[str] = []


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

            run = Run(
                *where,
                policy,
                chosen_seeds(seeds, episodes, 1),
                out=out,
                time_limit=finite(time_limit),
                action_repeat=action_repeat,
                scale=scale_of(progress, threads=threads, vectorised=vectorised),
                replaces=True,
                command=command_line(),
            )
        status = finish(run, progress, out)
    raise typer.Exit(status)
