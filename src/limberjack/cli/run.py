"""`limberjack run`: episodes of a task, their returns and, with --out, a report on them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import (
    Domain,
    FirstSeed,
    PolicyName,
    TaskName,
    TimeLimit,
    named_task,
    seeds_from,
)
from limberjack.cli.output import find_policy, misuse_reported
from limberjack.cli.playing import Playing

if TYPE_CHECKING:
    from limberjack.rl.control import Environment
    from limberjack.rollout import Episode, OnStep

__all__: list[str] = []


@command(
    "run",
    "limberjack run humanoid walk --policy random --episodes 3",
    "limberjack run humanoid/walk --policy sb3:walk.zip --out demo",
)
def _run(
    domain: Domain,
    task: TaskName = None,
    episodes: Annotated[int, typer.Option(min=1, help="Number of episodes.")] = 1,
    seed: FirstSeed = 0,
    policy: PolicyName = "zero",
    time_limit: TimeLimit = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write report.html, result.json, return.png and video.mp4 here, in the place of "
            "those of an earlier run of the same task and policy.",
        ),
    ] = None,
) -> None:
    """Run episodes of a task and show their returns.

    Each episode is the first one of an environment with its own seed, so any of them can be run
    again alone. The video shows the first episode.

    A policy of your own, MODULE:CALLABLE, is a function from an observation (a dictionary of
    arrays) to an action, or a class with act(observation) and, if it needs it, reset(). Its module
    may be in the working directory.
    """
    with misuse_reported():
        seeds = seeds_from(seed, episodes)
        run = _Run(*named_task(domain, task), seeds, policy, time_limit, out)
    raise typer.Exit(run.finish())


class _Run(Playing):
    """One call of `limberjack run`."""

    def _prepare(self, environment: "Environment") -> None:
        self._policy = find_policy(self._policy_name, environment)

    def _play_in(self, environment: "Environment", seed: int, on_step: "OnStep") -> "Episode":
        from limberjack import rollout

        return rollout.run_episode(environment, self._policy, seed, on_step)
