"""`limberjack run`: episodes of a task, in numbers and in pictures."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import app
from limberjack.cli.options import Domain, FirstSeed, PolicyName, TaskName, TimeLimit
from limberjack.cli.output import find_policy, misuse_reported
from limberjack.cli.playing import Playing

if TYPE_CHECKING:
    from limberjack.rl.control import Environment
    from limberjack.rollout import Episode, OnStep

__all__: list[str] = []


@app.command("run")
def _run(
    domain: Domain,
    task: TaskName,
    episodes: Annotated[int, typer.Option(min=1, help="How many to run.")] = 1,
    seed: FirstSeed = 0,
    policy: PolicyName = "zero",
    time_limit: TimeLimit = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write report.html, result.json, return.png and video.mp4 here."
        ),
    ] = None,
) -> None:
    """Run episodes of a task and show their returns.

    Each episode is the first one of an environment with its own seed, so any of them can be run
    again alone. The video shows the first episode.

    A policy of your own is a function from an observation (a dictionary of arrays) to an action, or
    a class with act(observation) and, if it needs it, reset(). Its module may lie in the working
    directory.
    """
    with misuse_reported():
        run = _Run(domain, task, range(seed, seed + episodes), policy, time_limit, out)
    raise typer.Exit(run.finish())


class _Run(Playing):
    """One call of `limberjack run`."""

    def __init__(
        self,
        domain: str,
        task: str,
        seeds: range,
        policy: str,
        time_limit: float | None,
        out: Path | None,
    ) -> None:
        """Checks everything that was asked for; raises ValueError or OSError."""
        self._policy_name = policy
        super().__init__(domain, task, seeds, policy, time_limit, out)

    def _prepare(self, environment: "Environment") -> None:
        self._policy = find_policy(self._policy_name)

    def _play_in(self, environment: "Environment", seed: int, on_step: "OnStep") -> "Episode":
        from limberjack import rollout

        return rollout.run_episode(environment, self._policy, seed, on_step)
