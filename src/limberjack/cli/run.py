"""`limberjack run`: episodes of a task, in numbers and in pictures."""

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from limberjack.cli.app import app
from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    SEEDS,
    Progress,
    complain,
    console,
    find_policy,
    misuse_reported,
    show_progress,
    table,
)

if TYPE_CHECKING:
    from limberjack.policies import Policy
    from limberjack.report import Recorder
    from limberjack.rollout import Episode

__all__: list[str] = []


@app.command("run")
def _run(
    domain: Annotated[
        str, typer.Argument(metavar="DOMAIN", help="Such as humanoid; `limberjack list` has all.")
    ],
    task: Annotated[str, typer.Argument(metavar="TASK", help="Such as walk.")],
    episodes: Annotated[int, typer.Option(min=1, help="How many to run.")] = 1,
    seed: Annotated[
        int, typer.Option(min=0, max=SEEDS - 1, help="Of the first episode; the next has seed+1.")
    ] = 0,
    policy: Annotated[
        str,
        typer.Option(metavar="NAME", help="What acts: zero, random, planner or MODULE:CALLABLE."),
    ] = "zero",
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds per episode; the task's own by default.")
    ] = None,
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
    failure = run.play()
    status = run.report(failure)
    if status is None:
        assert failure is not None
        raise failure
    raise typer.Exit(status)


class _Run:
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
        from limberjack import report

        if seeds[-1] >= SEEDS:
            raise ValueError(f"the last episode's seed is {seeds[-1]}; expected below {SEEDS}")
        if time_limit is not None and math.isinf(time_limit):
            raise ValueError(f"--time-limit is {time_limit}; expected a number of seconds")
        self._where = (domain, task)
        self._seeds = seeds
        self._time_limit = time_limit
        self._policy_name = policy
        first = self._load(seeds[0])
        self._policy: Policy = find_policy(policy)
        self._fingerprint = report.fingerprint(first.physics.model._model)
        self._control_timestep = first.control_timestep()
        self._step_limit = first.step_limit
        self._recorder: Recorder | None = None if out is None else report.Recorder(out)
        self._episodes: list[Episode] = []
        first.close()

    def play(self) -> BaseException | None:
        """Runs the episodes; returns what cut them short, if anything did."""
        try:
            with show_progress(len(self._seeds)) as progress:
                for seed in self._seeds:
                    self._episodes.append(self._play_episode(seed, progress))
        except BaseException as failure:  # Ctrl-C too: finished episodes are kept
            return failure
        return None

    def report(self, failure: BaseException | None) -> int | None:
        """Writes and prints what was played; returns the exit status, None for unknown failures."""
        from limberjack.policies import PolicyError
        from limberjack.rl.control import PhysicsError

        unwritten = self._write_files()  # first: printing fails where nobody reads
        _print_episodes(self._episodes)
        self._print_files()
        if unwritten is not None:
            complain(unwritten)
        if failure is None:
            return 0 if unwritten is None else FAILED
        done = f"{len(self._episodes)} of {len(self._seeds)} episodes finished"
        if isinstance(failure, KeyboardInterrupt):
            complain(f"interrupted: {done}")
            return INTERRUPTED
        if isinstance(failure, PolicyError | PhysicsError):
            complain(f"{failure}; {done}")
            return FAILED
        return None

    def _load(self, seed: int) -> Any:
        from limberjack import suite

        task_kwargs: dict[str, Any] = {"random": seed}
        if self._time_limit is not None:
            task_kwargs["time_limit"] = self._time_limit
        return suite.load(*self._where, task_kwargs=task_kwargs)

    def _play_episode(self, seed: int, progress: "Progress") -> "Episode":
        """The first episode of an environment with this seed."""
        from limberjack import rollout

        environment = self._load(seed)
        recorder = self._recorder if seed == self._seeds[0] else None
        if recorder is not None:
            recorder.begin(environment)
        limit = self._step_limit

        def on_step(steps: int, total: float) -> None:
            progress.show(seed - self._seeds[0], steps, limit, total)
            if recorder is not None:
                recorder.add_step(steps)

        with contextlib.closing(environment):
            episode = rollout.run_episode(environment, self._policy, seed, on_step)
            if recorder is not None:
                recorder.finish_film()
        return episode

    def _write_files(self) -> OSError | None:
        """Writes what was asked for; returns why it could not."""
        if self._recorder is None:
            return None
        domain, task = self._where
        time_limit = self._time_limit
        if time_limit is None and self._step_limit is not None:
            time_limit = self._step_limit * self._control_timestep
        run = {
            "domain": domain,
            "task": task,
            "policy": self._policy_name,
            "time_limit": time_limit,
            "control_timestep": self._control_timestep,
            "episodes_asked_for": len(self._seeds),
        }
        try:
            self._recorder.write(run, self._episodes, self._fingerprint)
        except OSError as error:
            return error
        return None

    def _print_files(self) -> None:
        if self._recorder is None:
            return
        for line in self._recorder.left_out:
            complain(line)
        for path in self._recorder.written:
            typer.echo(path)


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
