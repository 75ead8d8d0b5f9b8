"""`limberjack solve`: episodes of a task, played by the planner and recorded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from limberjack.cli.app import command
from limberjack.cli.options import Domain, FirstSeed, TaskName, TimeLimit, named_task
from limberjack.cli.output import misuse_reported
from limberjack.cli.playing import Playing

if TYPE_CHECKING:
    from limberjack.rl.control import Environment
    from limberjack.rollout import Episode, OnStep, Step

__all__: list[str] = []


@command("solve", "limberjack solve manipulator bring_ball --seed 3 --out solved")
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
            "video.mp4 here.",
        ),
    ] = None,
    threads: Annotated[
        int | None,
        typer.Option(min=1, help="Threads that simulate; all usable cores by default."),
    ] = None,
) -> None:
    """Play episodes of a task with the planner, which simulates the outcomes of its actions.

    It plans from the simulator's full state, not from observations. The same seed gives the same
    episode at any number of threads. With --out each episode is recorded, for `limberjack replay`.
    """
    with misuse_reported():
        seeds = range(seed, seed + episodes)
        solving = _Solving(*named_task(domain, task), seeds, "planner", time_limit, out, threads)
    raise typer.Exit(solving.finish())


class _Solving(Playing):
    """One call of `limberjack solve`."""

    expected = (OSError,)  # a recording that cannot be written

    def __init__(
        self,
        domain: str,
        task: str,
        seeds: range,
        policy: str,
        time_limit: float | None,
        out: Path | None,
        threads: int | None,
    ) -> None:
        """Checks all arguments; raises ValueError or OSError."""
        self._out = out
        self._threads = threads
        super().__init__(domain, task, seeds, policy, time_limit, out)

    def _prepare(self, environment: "Environment") -> None:
        from limberjack.planner import cost_for

        cost_for(environment.task)

    def _names_of_recordings(self) -> list[str]:
        return [_name_of_recording(seed) for seed in self._seeds]

    def _play_in(self, environment: "Environment", seed: int, on_step: "OnStep") -> "Episode":
        from limberjack import policies, report, rollout
        from limberjack.planner.record import Transcript

        transcript = Transcript(environment)

        def add(step: "Step") -> None:
            transcript.add(step)
            on_step(step)

        episode = rollout.run_episode(
            environment, policies.planner_with(self._threads), seed, on_step=add
        )
        if self._out is not None:
            versions = {"versions": report.versions(), "fingerprint": self._fingerprint}
            path = self._out / _name_of_recording(seed)
            transcript.recording({**self._about, "seed": seed, **versions}).save(path)
            self._recordings.append(path)
        return episode


def _name_of_recording(seed: int) -> str:
    return f"episode-{seed}.npz"
