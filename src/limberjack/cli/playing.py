"""`Playing`: the part that `limberjack run` and `limberjack solve` share.

It plays the episodes, prints their returns and writes their files.
"""

import contextlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from limberjack.cli.output import (
    FAILED,
    INTERRUPTED,
    complain,
    console,
    table,
    users_failure,
    worded,
)
from limberjack.cli.progress import Episodes, show_episodes
from limberjack.cli.typed import command_line

if TYPE_CHECKING:
    from limberjack.report import Facts, Recorder
    from limberjack.rl.control import Environment
    from limberjack.rollout import Episode, OnStep, Step

__all__ = ["Playing"]


class Playing:
    """Episodes of a task, from the first seed to the last, with the policy of a command.

    Attributes:
      expected: errors of the command's own that are reported in one line.
    """

    expected: tuple[type[Exception], ...] = ()

    def __init__(
        self,
        domain: str,
        task: str,
        seeds: Sequence[int],
        policy: str,
        time_limit: float | None,
        out: Path | None,
    ) -> None:
        """Checks all arguments; raises ValueError or OSError."""
        from limberjack import report

        self._policy_name = policy
        if time_limit is not None and math.isinf(time_limit):
            raise ValueError(f"--time-limit is {time_limit}; expected a number of seconds")
        self._where = (domain, task)
        self._seeds = seeds
        self._time_limit = time_limit
        with contextlib.closing(self._load(seeds[0])) as first:
            if first.step_limit is None:
                raise ValueError(
                    f"{domain} {task} has no time limit of its own, so an episode might never end: "
                    "give --time-limit SECONDS"
                )
            self._prepare(first)
            self._fingerprint = report.fingerprint(first.physics.model._model)
            self._step_limit = first.step_limit
            self._about: Facts = {"domain": domain, "task": task, "policy": policy}
            self._about["time_limit"] = self._seconds(first)
            self._about["control_timestep"] = first.control_timestep()
        self._recorder: Recorder | None = None
        if out is not None:
            self._recorder = report.Recorder(
                out, self._about, command_line(), recordings=self._names_of_recordings()
            )
        self._recordings: list[Path] = []  # files that the command has written itself
        self._episodes: list[Episode] = []

    def _prepare(self, environment: "Environment") -> None:
        """Finds the policy; raises ValueError if there is none for this task."""
        raise NotImplementedError

    def _names_of_recordings(self) -> list[str]:
        """The files that the command writes itself, in the folder of the others."""
        return []

    def _play_in(self, environment: "Environment", seed: int, on_step: "OnStep") -> "Episode":
        """Plays an episode from the environment's reset on.

        Args:
          environment: made with the seed.
          seed: of the episode.
          on_step: as `rollout.run_episode` takes it.
        """
        raise NotImplementedError

    def _seconds(self, environment: "Environment") -> float | None:
        """The time limit given, else the task's own; None without any."""
        if self._time_limit is not None or environment.step_limit is None:
            return self._time_limit
        return environment.step_limit * environment.control_timestep()

    def finish(self) -> int:
        """Plays, writes and prints; returns the exit status and raises unexpected errors."""
        try:
            failure = self.play()
            status = self.report(failure)
        finally:
            if self._recorder is not None:
                self._recorder.close()
        if status is None:
            assert failure is not None
            raise failure
        return status

    def play(self) -> BaseException | None:
        """Runs the episodes; returns the error or interrupt that ended them early, if any."""
        try:
            with show_episodes(len(self._seeds), self._recorder is not None) as progress:
                for seed in self._seeds:
                    self._episodes.append(self._play_episode(seed, progress))
        except BaseException as failure:  # Ctrl-C too: finished episodes are kept
            return failure
        return None

    def report(self, failure: BaseException | None) -> int | None:
        """Writes and prints the episodes; returns the exit status, None for unknown failures."""
        from limberjack.policies import PolicyError
        from limberjack.rl.control import PhysicsError

        unwritten = self._write_files()  # first, because printing to a closed pipe fails
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
        if isinstance(failure, (PolicyError, PhysicsError, *self.expected)):
            complain(f"{worded(failure)}; {done}")
            return FAILED
        sentence = users_failure(failure)
        if sentence is None:
            return None
        complain(f"{sentence}; {done}")
        return FAILED

    def _load(self, seed: int) -> "Environment":
        from limberjack import suite

        task_kwargs: dict[str, float] = {"random": seed}
        if self._time_limit is not None:
            task_kwargs["time_limit"] = self._time_limit
        return suite.load(*self._where, task_kwargs=task_kwargs)

    def _play_episode(self, seed: int, progress: Episodes) -> "Episode":
        """The first episode of an environment with this seed."""
        environment = self._load(seed)
        recorder = self._recorder if seed == self._seeds[0] else None
        if recorder is not None:
            recorder.begin(environment)
        with contextlib.closing(environment):
            episode = self._play_in(environment, seed, self._shown(seed, progress))
            if recorder is not None:
                recorder.finish_film()
        return episode

    def _shown(self, seed: int, progress: Episodes) -> "OnStep":
        """A function that shows the steps of an episode, and films them if it is the first."""
        finished, limit = self._seeds.index(seed), self._step_limit
        recorder = self._recorder if finished == 0 else None

        def on_step(step: "Step") -> None:
            progress.show(finished, step.number, limit, step.total)
            if recorder is not None:
                with progress.drawing():
                    recorder.add_step(step)

        return on_step

    def _write_files(self) -> OSError | None:
        """Writes the files, if any; returns the error if that failed."""
        if self._recorder is None:
            return None
        run = {**self._about, "episodes_asked_for": len(self._seeds)}
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
        for path in [*self._recorder.written, *self._recordings]:
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
