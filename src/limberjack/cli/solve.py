"""`limberjack solve`: episodes of a task with the planner."""

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
    misuse_reported,
    show_progress,
    table,
)

if TYPE_CHECKING:
    from limberjack.planner.record import Recording
    from limberjack.rollout import Episode

__all__: list[str] = []


@app.command("solve")
def _solve(
    domain: Annotated[
        str,
        typer.Argument(metavar="DOMAIN", help="Such as manipulator; `limberjack list` has all."),
    ],
    task: Annotated[str, typer.Argument(metavar="TASK", help="Such as bring_ball.")],
    episodes: Annotated[int, typer.Option(min=1, help="How many to play.")] = 1,
    seed: Annotated[
        int, typer.Option(min=0, max=SEEDS - 1, help="Of the first episode; the next has seed+1.")
    ] = 0,
    time_limit: Annotated[
        float | None, typer.Option(help="Seconds per episode; the task's own by default.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Write the recordings, report.html, result.json and video.mp4 here."
        ),
    ] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="That simulate; all usable cores by default.")
    ] = None,
) -> None:
    """Play episodes of a task with the planner, which simulates what would follow its actions.

    It plans from the simulator's full state, not from observations. The same seed gives the same
    episode at any number of threads. With --out each episode is recorded, for `limberjack replay`.
    """
    with misuse_reported():
        solving = _Solving(domain, task, range(seed, seed + episodes), time_limit, out, threads)
    raise typer.Exit(solving.play())


class _Solving:
    """One call of `limberjack solve`."""

    def __init__(
        self,
        domain: str,
        task: str,
        seeds: range,
        time_limit: float | None,
        out: Path | None,
        threads: int | None,
    ) -> None:
        """Checks everything that was asked for; raises ValueError or OSError."""
        from limberjack import report
        from limberjack.planner import cost_for

        if seeds[-1] >= SEEDS:
            raise ValueError(f"the last episode's seed is {seeds[-1]}; expected below {SEEDS}")
        if time_limit is not None and math.isinf(time_limit):
            raise ValueError(f"--time-limit is {time_limit}; expected a number of seconds")
        self._seeds = seeds
        self._threads = threads
        self._about: dict[str, Any] = {"domain": domain, "task": task, "policy": "planner"}
        self._time_limit = time_limit
        with contextlib.closing(self._load(seeds[0])) as first:
            cost_for(first.task)
            self._fingerprint = report.fingerprint(first.physics.model._model)
            self._step_limit = first.step_limit
            self._about["time_limit"] = first.step_limit * first.control_timestep()
            self._about["control_timestep"] = first.control_timestep()
        self._out = out
        self._recorder = None if out is None else report.Recorder(out)
        self._recordings: list[Path] = []
        self._episodes: list[Episode] = []

    def play(self) -> int:
        """Plays, writes and prints; returns the exit status."""
        failure: BaseException | None = None
        try:
            with show_progress(len(self._seeds)) as progress:
                for seed in self._seeds:
                    self._episodes.append(self._play_episode(seed, progress))
        except BaseException as error:  # Ctrl-C too: finished episodes are kept
            failure = error
        unwritten = self._write_files()
        self._print()
        if unwritten is not None:
            complain(unwritten)
        return self._status(failure, unwritten)

    def _status(self, failure: BaseException | None, unwritten: OSError | None) -> int:
        from limberjack.rl.control import PhysicsError

        if failure is None:
            return 0 if unwritten is None else FAILED
        done = f"{len(self._episodes)} of {len(self._seeds)} episodes finished"
        if isinstance(failure, KeyboardInterrupt):
            complain(f"interrupted: {done}")
            return INTERRUPTED
        if isinstance(failure, PhysicsError | OSError):
            complain(f"{failure}; {done}")
            return FAILED
        raise failure

    def _load(self, seed: int) -> Any:
        from limberjack import suite

        task_kwargs: dict[str, Any] = {"random": seed}
        if self._time_limit is not None:
            task_kwargs["time_limit"] = self._time_limit
        return suite.load(self._about["domain"], self._about["task"], task_kwargs=task_kwargs)

    def _play_episode(self, seed: int, progress: Progress) -> "Episode":
        """The first episode of an environment with this seed."""
        from limberjack import report
        from limberjack.planner import Planner
        from limberjack.planner.record import record_episode
        from limberjack.rollout import Episode

        recorder = self._recorder if seed == self._seeds[0] else None
        with contextlib.closing(self._load(seed)) as environment:
            planner = Planner(environment, self._threads, seed)
            start: list[str | None] = []

            def on_step(steps: int, total: float) -> None:
                progress.show(seed - self._seeds[0], steps, self._step_limit, total)
                if not steps:
                    start.append(environment.task.start(environment.physics))
                if recorder is not None and not steps:
                    recorder.begin(environment)
                if recorder is not None:
                    recorder.add_step(steps)

            versions = {"versions": report.versions(), "fingerprint": self._fingerprint}
            about = {**self._about, "seed": seed, **versions}
            recording = record_episode(environment, planner.act, about, on_step)
            if recorder is not None:
                recorder.finish_film()
        self._keep(recording, seed)
        return Episode(seed, start[0], recording.rewards)

    def _keep(self, recording: "Recording", seed: int) -> None:
        if self._out is not None:
            path = self._out / f"episode-{seed}.npz"
            recording.save(path)
            self._recordings.append(path)

    def _write_files(self) -> OSError | None:
        """Writes what was asked for; returns why it could not."""
        if self._recorder is None:
            return None
        run = {**self._about, "episodes_asked_for": len(self._seeds)}
        try:
            self._recorder.write(run, self._episodes, self._fingerprint)
        except OSError as error:
            return error
        return None

    def _print(self) -> None:
        rows = table("seed>", "start", "return>", "steps>")
        for episode in self._episodes:
            total = f"{episode.total:.3f}"
            rows.add_row(str(episode.seed), episode.start or "", total, str(episode.length))
        if self._episodes:
            console().print(rows)
        if self._recorder is None:
            return
        for line in self._recorder.left_out:
            complain(line)
        for path in [*self._recorder.written, *self._recordings]:
            typer.echo(path)
